"""A small robot, its logs, and a learner that costs nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from etude.campaign import (
    Campaign,
    PrequentialScore,
    State,
    Trained,
    TrainingOutcome,
    create_campaign,
    typical_motions,
)
from etude.protocols import Trajectory
from etude.storage import write_atomic
from etude.types import Array

ROBOT = """\
name = "pair"
command_unit = "N m"
rate = 50.0
[[axis]]
name = "hip"
lower = -1.0
upper = 1.0
velocity = 1.0
acceleration = 2.0
command = 20.0
[[axis]]
name = "knee"
lower = -1.5
upper = 0.5
velocity = 1.0
acceleration = 2.0
command = 10.0
"""
SHORT = """\
[trajectory]
duration = 8.0
[data]
cutoff_hz = 5.0
[design]
candidates = 4
refine = 1
steps = 3
points = 20
reference_points = 30
"""
DRAWN: dict[tuple[object, ...], Trajectory] = {}
ALONE = '[model]\ncandidates = ["default"]\n'
"""Trainings of one member, a fifth of the work: what several members do is tested in `tests/models`."""


def stub_learner(campaign: Campaign, state: State, number: int) -> TrainingOutcome:
    """Stores one small file and scores nothing; the forecast improves with each log."""
    path = campaign.model_folder(number) / "model.json"
    write_atomic(path, f'{{"logs": {[r.number for r in state.ingested]}}}'.encode())
    deviation = 20.0 * 0.5 ** (1 + len(state.trained)), 10.0 * 0.5 ** (1 + len(state.trained))
    learned = Trained(
        models={"gp": PrequentialScore(nmse=(0.1, 0.2), z2=(1.0, 1.0), coverage=(0.95, 0.95))},
        chosen="gp",
        robot_seconds=state.robot_seconds,
        forecast_deviation=deviation,
        latent_deviation=deviation,
        noise_deviation=(0.1, 0.1),
    )
    return TrainingOutcome([path], learned)


def make_campaign(folder: Path, seed: int = 5, config: str = SHORT + ALONE) -> Campaign:
    """A campaign of 12 s trajectories for the pair."""
    from etude.campaign import open_campaign

    folder.mkdir(parents=True, exist_ok=True)
    robot = folder / "pair.toml"
    robot.write_text(ROBOT)
    path = create_campaign(folder / "lab", str(robot), seed=seed)[0].path
    (path / "campaign.toml").write_text(f'kind = "arm"\nseed = {seed}\n{config}')
    return open_campaign(path)


def random_motion(campaign: Campaign, seed: int) -> Trajectory:
    """A motion inside the limits that nobody asked for; drawn once of the same files."""
    files = (path for path in campaign.path.iterdir() if path.suffix in (".toml", ".urdf", ".xml"))
    key = (seed, *sorted(path.read_bytes() for path in files))
    if key not in DRAWN:
        DRAWN[key] = typical_motions(campaign, np.random.default_rng(seed), 1)[0]
    return DRAWN[key]


def command_of(q: Array, qd: Array, qdd: Array) -> Array:
    """What the pair's motors do: no rigid body, but smooth."""
    return np.asarray(2.0 * qdd + 1.5 * np.tanh(qd / 0.05) + 3.0 * np.sin(q))


def write_log(path: Path, trajectory: Trajectory, seed: int = 0, start: float = 1.7e9) -> Path:
    """A CSV of a robot that follows the trajectory after 1 s of standing still."""
    rng = np.random.default_rng(seed)
    t = np.arange(-1.0, trajectory.duration + 0.5, 0.02)
    true = trajectory.motion(t, 3).orders
    q = true[0] + 1e-4 * rng.standard_normal(true[0].shape)
    rows = np.column_stack([t + start, q, command_of(*true)])
    lines = ["time,q_hip,q_knee,tau_hip,tau_knee", *(",".join(map(repr, row)) for row in rows.tolist())]
    path.write_text("\n".join(lines) + "\n")
    return path
