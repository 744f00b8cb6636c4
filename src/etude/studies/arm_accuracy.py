"""How well every member of the model family predicts the simulated arm: error, calibration and fit time.

Logs of random motions under PD control alone, preprocessed as a campaign does by default; one trajectory is
held out. Figures are means over the joints and the seeds, on samples where that joint moves.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from etude.control.closed_loop import run_closed_loop
from etude.control.feedforward import no_feedforward
from etude.models.blocks import linear_regression
from etude.models.calibration import score
from etude.models.dataset import Dataset, concatenate
from etude.models.inverse_dynamics import feature_map
from etude.models.model_config import ModelConfig
from etude.models.output_process import LARGEST_FLOOR
from etude.models.preprocess import build_dataset, preset
from etude.plants.registry import simulated_robot
from etude.robots.spec import RobotSpec
from etude.studies.model_members import MEMBERS, Member
from etude.studies.rows import Row, mean_rows
from etude.trajectories.family import TrajectoryFamily
from etude.trajectories.random import random_trajectory

Array = NDArray[np.float64]

ROBOT = "arm4"
TRAINING = 3
DURATION_S = 60.0
SEEDS, QUICK_SEEDS = 8, 2
FLOOR = 0.002
"""Noise floor as a part of the command limit, the default of `ModelConfig`."""


def member_rows(rng: np.random.Generator, *, quick: bool = False) -> list[Row]:
    """`nmse_`, `z2_<model>_arm4` and `fit_s_<model>` of every member; nMSE beside linear regression's."""
    robot = simulated_robot(ROBOT, engine="compiled")
    figures: dict[str, list[tuple[float, float, float]]] = {name: [] for name in ("linear", *MEMBERS)}
    _compile_members(robot.spec.dof)
    for own in rng.spawn(QUICK_SEEDS if quick else SEEDS):
        train, test = arm_data(own)
        linear = score(test.tau, linear_regression(train, test), None, ~test.stuck)
        figures["linear"].append((float(np.nanmean(linear.nmse)), np.nan, np.nan))
        for name, member in MEMBERS.items():
            figures[name].append(_measure(member, train, test, robot.spec, own))
    linear_nmse = [nmse for nmse, _, _ in figures.pop("linear")]
    rows = []
    for name, (nmse, z2, seconds) in ((name, zip(*found, strict=True)) for name, found in figures.items()):
        named = f"linear regression, {len(linear_nmse)} seeds"
        rows += mean_rows(f"nmse_{name}_{ROBOT}", nmse, "1", named, linear_nmse)
        rows.append(Row(f"z2_{name}_{ROBOT}", float(np.mean(z2)), "1", "calibrated", 1.0))
        rows.append(Row(f"fit_s_{name}", float(np.mean(seconds)), "s", f"all {robot.spec.dof} outputs"))
    return rows


def arm_data(rng: np.random.Generator) -> tuple[Dataset, Dataset]:
    """Samples of `TRAINING` random motions, and of one more."""
    robot, family = simulated_robot(ROBOT, engine="compiled"), TrajectoryFamily(duration=DURATION_S)
    parts = []
    for number in range(TRAINING + 1):
        trajectory = random_trajectory(rng, robot.spec, family)
        log = run_closed_loop(robot, trajectory, no_feedforward(robot.spec), rng)
        parts.append(build_dataset(log, robot.spec, preset("default"), number))
    return concatenate(parts[:-1]), parts[-1]


def _compile_members(inputs: int) -> None:
    """Each member once on a few points: compilation on first use is not the time to fit."""
    rng = np.random.default_rng(0)
    X, y = rng.normal(size=(2 * inputs, inputs)), rng.normal(size=2 * inputs)
    for member in MEMBERS.values():
        member(X, y, 0.1, rng)


def _measure(
    member: Member, train: Dataset, test: Dataset, spec: RobotSpec, rng: np.random.Generator
) -> tuple[float, float, float]:
    """nMSE and z² over the joints, and the seconds that training all of them took."""
    features = feature_map(spec, ModelConfig())
    X, at = (features.transform(data.q, data.qd, data.qdd) for data in (train, test))
    mean, variance = np.empty_like(test.tau), np.empty_like(test.tau)
    seconds = 0.0
    for j in range(spec.dof):
        moving = ~train.stuck[:, j]
        tau = train.tau[moving, j]
        offset = float(tau.mean())
        floor = min(FLOOR * float(spec.command[j]), LARGEST_FLOOR * float(tau.std()))
        start = time.perf_counter()
        posterior = member(X[moving], tau - offset, floor, rng)
        seconds += time.perf_counter() - start
        predicted, latent = posterior.predict(at)
        mean[:, j], variance[:, j] = predicted + offset, latent + posterior.noise_variance
    found = score(test.tau, mean, variance, ~test.stuck)
    return float(np.nanmean(found.nmse)), float(np.nanmean(found.z2)), seconds
