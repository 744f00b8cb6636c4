"""Joints that creep while others move: where friction turns with the speed, slow samples teach."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

plant = pytest.importorskip("pinocchio_arm", reason="pinocchio has no wheel for this Python or system")

from small_arm import URDF, campaign_of_small_arm  # noqa: E402

from etude import predict, tell  # noqa: E402
from etude.campaign import Campaign, newest_model, open_campaign  # noqa: E402
from etude.logs import read_log  # noqa: E402

SINGLE = "row_deviation"
CREEP = 0.03
"""Part of the top speed below which friction turns over."""
ALIKE = 3.0
"""Error of slow joints over that of moving ones: exact friction leaves cogging and noise to both. Where slow
samples are left out it is 4.6, with them 2.3."""


@dataclass(frozen=True)
class Lab:
    campaign: Campaign
    arm: plant.Arm
    folder: Path


pytestmark = pytest.mark.slow  # a campaign of its own, learned twice


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Lab:
    folder = tmp_path_factory.mktemp("slow")
    campaign, arm = campaign_of_small_arm(folder, 24.0), plant.arm_of_urdf(URDF, seed=4, wrong=1.3)
    file = campaign.path / "campaign.toml"
    file.write_text(file.read_text().replace('["default"]', '["default", "standing", "slow"]'))
    campaign = open_campaign(campaign.path)
    run = plant.run(arm, motion(arm, 60.0, 0.0), seed=1)
    (folder / "log.csv").write_bytes(run.log())
    tell(campaign, folder / "log.csv")
    return Lab(campaign, arm, folder)


def motion(arm: plant.Arm, seconds: float, phase: float) -> plant.Reference:
    """Three harmonics of each joint, from rest to rest, inside half of the ranges and of the speeds."""
    t = np.arange(round(seconds * plant.RATE) + 1) / plant.RATE
    q = np.zeros((len(t), len(arm.names)))
    for k in range(len(arm.names)):
        for n, size in enumerate((0.6, 0.25, 0.15)):
            q[:, k] += size * np.sin((0.5 + 0.47 * n + 0.11 * k) * t + phase + 2.0 * k + n)
    u = np.clip(np.minimum(t, t[-1] - t) / 2.0, 0.0, 1.0)[:, None]
    q *= 0.25 * (arm.upper - arm.lower) * u**3 * (10 - 15 * u + 6 * u**2)
    qd = np.gradient(q, t, axis=0)
    return plant.Reference(t, q, qd, np.gradient(qd, t, axis=0))


def commanded(lab: Lab, t: np.ndarray, *states: np.ndarray) -> np.ndarray:
    """(T, J) what `predict` says of q, qd, qdd (T, J) each, from a file of every fourth row."""
    header = ["time", *(f"{word}_{name}" for word in ("q", "qd", "qdd") for name in lab.campaign.axes)]
    place = lab.folder / "states.csv"
    rows = np.column_stack([t, *states])[::4]
    np.savetxt(place, rows, delimiter=",", header=",".join(header), comments="", fmt="%.12g")
    said = predict(lab.campaign, place)
    return np.stack([np.interp(t, said.t, column) for column in said["command"].T], axis=1)


def test_slow_joint_is_predicted_as_well_as_a_moving_one(lab: Lab) -> None:
    run = plant.run(lab.arm, motion(lab.arm, 16.0, 1.3), seed=3)
    states = [run.q, run.qd, np.gradient(run.qd, 1.0 / plant.RATE, axis=0)]
    step = 4
    said = commanded(lab, run.reference.t, *states)
    error = (said[::step] - run.command[::step]) / lab.arm.torque
    slow = np.abs(run.qd[::step]) < CREEP * lab.arm.speed
    inner = slice(500, -500)
    size = [float(np.sqrt(np.mean(error[inner][use[inner]] ** 2))) for use in (slow, ~slow)]
    assert size[0] < ALIKE * size[1], size


HELD, MOST_PUSH = 10.0, 0.25
"""Seconds that a pose is held after a motion. Part of the Coulomb friction that the command may push there
beside gravity and cogging; friction that is remembered pushes by all of it."""


def test_a_pose_is_held_without_a_push(lab: Lab) -> None:
    wanted = plant.held(motion(lab.arm, 16.0, 0.4), before=0.0, after=HELD)
    cut = slice(0, round(11.3 * plant.RATE))  # in the midst of the motion, where gravity and friction act
    still = np.zeros((round(HELD * plant.RATE), 3))
    q = np.concatenate([wanted.q[cut], np.broadcast_to(wanted.q[cut][-1], still.shape)])
    states = [q, np.concatenate([wanted.qd[cut], still]), np.concatenate([wanted.qdd[cut], still])]
    said = commanded(lab, np.arange(len(q)) / plant.RATE, *states)[-1]
    data = lab.arm.true.createData()
    holds = plant.pin.computeGeneralizedGravity(lab.arm.true, data, q[-1]) + lab.arm.drives.ripple(q[-1])
    assert np.all(np.abs(said - holds) < MOST_PUSH * lab.arm.drives.coulomb), said - holds


def test_slow_samples_teach_where_all_samples_are_predicted_better_so(lab: Lab) -> None:
    model = newest_model(lab.campaign, lab.campaign.state())
    slow = [c for c in model.candidates if c.name == "slow" and c.structure == "identified+gp"]
    assert [c.commands for c in slow] == [(0,), (1,), (2,)]
    assert min(float(c.share[0]) for c in slow) > 0.5
    usual = next(c for c in model.candidates if c.structure == "identified" and c.name == "default")
    v0 = usual.mean.model.friction_velocity
    for candidate in slow:
        np.testing.assert_allclose(candidate.mean.model.friction_velocity, 0.1 * v0)


def test_single_rows_scatter_by_what_the_filter_takes_away(lab: Lab) -> None:
    """The sensor's noise and steps, which the plant knows, and what of the command lies above the cutoff."""
    run = plant.run(lab.arm, motion(lab.arm, 16.0, 2.1), seed=5)
    place = lab.folder / "new.csv"
    place.write_bytes(run.log())
    said, log = predict(lab.campaign, place), read_log(place, lab.campaign.channels, rate=250.0)
    raw = log["command"][np.searchsorted(log.t, said.t).clip(0, len(log) - 1)]
    held = [np.mean(np.abs(raw - said["command"]) < 1.96 * said[of], axis=0) for of in ("deviation", SINGLE)]
    # after one log the model's own deviations are a little small (.89 of the rows of the worst joint)
    assert (held[1] > np.maximum(0.85, held[0])).all(), held
    more = np.sqrt(said[SINGLE] ** 2 - said["deviation"] ** 2)
    noise = np.hypot(lab.arm.drives.torque_noise, lab.arm.drives.torque_step / np.sqrt(12.0))
    assert ((more > 0.9 * noise) & (more < 2.0 * noise)).all(), more[0] / noise
