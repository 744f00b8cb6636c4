"""A joint that is only held while others move: what answers its sag is the feedback, and no dynamics."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

plant = pytest.importorskip("pinocchio_arm", reason="pinocchio has no wheel for this Python or system")

from exported_doors import asked, built  # noqa: E402
from pinocchio_arm import pin  # noqa: E402
from small_arm import URDF, campaign_of_small_arm  # noqa: E402

import etude  # noqa: E402

HELD = 2


def walk(arm: plant.Arm) -> plant.Reference:
    """30 s of sines of the other joints; the last one is told to stay."""
    t = np.arange(round(30.0 * plant.RATE) + 1) / plant.RATE
    rng, middle = np.random.default_rng(4), 0.5 * (arm.lower + arm.upper)
    ramp = np.clip(np.minimum(t, t[-1] - t) / 2.0, 0.0, 1.0)[:, None]
    window = ramp**3 * (10 - 15 * ramp + 6 * ramp**2)
    path = sum(
        np.sin(2 * np.pi * hz * t[:, None] + rng.uniform(0, 2 * np.pi, 3)) for hz in (0.05, 0.11, 0.17, 0.23)
    )
    q = middle + 0.08 * (arm.upper - arm.lower) * window * path
    q[:, HELD] = middle[HELD]
    qd = np.gradient(q, t, axis=0)
    return plant.Reference(t, q, qd, np.gradient(qd, t, axis=0))


@pytest.mark.slow
def test_the_command_of_a_held_joint_is_gravity_and_not_the_feedbacks_law(tmp_path: Path) -> None:
    arm = plant.arm_of_urdf(URDF, seed=5, wrong=1.0)
    # no friction where it hangs: it sags
    drives = replace(arm.drives, coulomb=0.02 * arm.drives.coulomb, stiction=0.0 * arm.drives.stiction)
    run = plant.run(replace(arm, drives=drives), walk(arm), "pd")
    sag = np.ptp(run.q[:, HELD])
    assert 0.003 < sag / (arm.upper - arm.lower)[HELD] < 0.02  # moves, and by next to nothing
    campaign = campaign_of_small_arm(tmp_path)
    (tmp_path / "run.csv").write_bytes(run.log())
    found = etude.tell(campaign, tmp_path / "run.csv", foreign=True)
    assert any("bend" in str(notice) for notice in found.warnings)
    poses = np.repeat(walk(arm).q[-1:], 21, axis=0)
    poses[:, HELD] += np.linspace(-0.2, 0.2, 21)
    orders = np.stack([poses, 0.0 * poses, 0.0 * poses])
    etude.export(campaign.path, "c", tmp_path / "c", name="arm")
    _, (mean, _, gravity) = asked(built(tmp_path / "c", "arm"), orders)
    data = arm.believed.createData()
    true = np.stack([pin.computeGeneralizedGravity(arm.believed, data, q) for q in poses])
    for said in (mean, gravity, etude.load_model(campaign.path).gravity(poses)):
        assert np.abs(said - true)[:, HELD].max() < 0.03 * arm.torque[HELD]
