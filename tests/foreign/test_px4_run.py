"""`etude run` with a multirotor: rotorpy's vehicle behind the mock of PX4's MAVLink, in virtual time."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("pymavlink", reason="the driver px4 needs pymavlink")

import numpy as np
from flight_lab import PROMPT, ROBOT, run
from flights import QUICK

from etude.campaign import open_campaign

DRIVER = Path(__file__).with_name("px4_rotorpy.py")


@pytest.mark.slow
def test_the_learned_drag_halves_the_error_of_a_motion_that_no_model_learned(tmp_path: Path) -> None:
    """Flown, recorded, learned and confirmed without a hand."""
    lab, robot = tmp_path / "lab", tmp_path / "quad.toml"
    robot.write_text(ROBOT + PROMPT)  # it flies by rotorpy's SE(3)
    run("init", lab, "--robot", robot)
    settings = (lab / "campaign.toml").read_text()
    for slow, quick in QUICK.items():
        assert slow in settings
        settings = settings.replace(slow, quick)
    (lab / "campaign.toml").write_text(settings)
    run("run", lab, "--on", f"{DRIVER}:vehicle", "--rounds", 1, "--yes")
    campaign = open_campaign(lab)
    (taken,) = campaign.state().ingested
    assert taken.number == 1
    (confirming,) = campaign.state().confirmations
    without, own = (np.linalg.norm(confirming.runs[name].error) for name in ("without", "with"))
    print(f"mean error {without:.4f} m without, {own:.4f} m with the learned drag: ratio {own / without:.2f}")
    assert own < 0.6 * without
