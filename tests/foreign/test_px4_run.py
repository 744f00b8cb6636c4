"""`etude run` with a multirotor: rotorpy's vehicle behind the mock of PX4's MAVLink, in virtual time."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("pymavlink", reason="the extra px4")

from flight_lab import ROBOT, run

from etude.campaign import open_campaign

DRIVER = Path(__file__).with_name("px4_rotorpy.py")


@pytest.mark.slow
def test_a_flight_is_flown_recorded_and_taken_in_without_a_hand(tmp_path: Path) -> None:
    lab, robot = tmp_path / "lab", tmp_path / "quad.toml"
    robot.write_text(ROBOT)
    run("init", lab, "--robot", robot)
    run("run", lab, "--on", f"{DRIVER}:vehicle", "--rounds", 1, "--yes")
    (taken,) = open_campaign(lab).state().ingested
    assert taken.number == 1
