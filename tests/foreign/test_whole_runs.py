"""Robots whose first runs ended without a model: `etude init`, then `etude run`, and no hand."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("pinocchio", reason="pinocchio has no wheel for this Python or system: pip install pin")
pytest.importorskip("gymnasium", reason="pip install gymnasium")

from measure_runs import ROBOTS, begun, campaign, etude


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pr2", "baxter"])
def test_drives_that_hold_an_arm_in_a_part_of_its_range_get_a_first_motion(tmp_path: Path, name: str) -> None:
    """pr2's drives hold one clear pose in thirty."""
    refused, _ = begun(ROBOTS[name], tmp_path)
    assert not refused
    done = etude("ask", str(tmp_path / "lab"))
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_a_hand_whose_first_motion_is_slow_is_not_stopped(tmp_path: Path) -> None:
    """Its third motion was three times as fast as its logs, and its forces 20 % off."""
    refused, _ = begun(ROBOTS["allegro"], tmp_path)
    assert not refused
    found = campaign(tmp_path, 1)
    assert found["exit_code"] == 0, found["why_not"]
    assert found["promoted"], found["why_not"]
