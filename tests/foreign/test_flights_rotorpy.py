"""What leaves a campaign of a vehicle, flown in a plant and by controllers of others."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rotorpy", reason="rotorpy is not installed: pip install 'etude[test]'")

from flight_lab import exported, learned_lab, table_of
from rotorpy_vehicle import Geometric, fly

from etude import plugins
from etude.trajectories.fourier import FourierTrajectory
from etude.trajectories.json_text import from_json


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found, _ = learned_lab(tmp_path_factory.mktemp("rotorpy"), 2, quick=True)
    return found


def eight(folder: Path, size: float = 1.9, pace: float = 0.9, seconds: float = 14.0) -> Path:
    """A figure of eight about 3 m above the ground and its file."""
    speeds = np.zeros((5, 3))
    speeds[1, 0], speeds[4, 1], speeds[3, 2] = size * pace, size * pace, 0.5 * pace
    speeds[0] = [0.0, 0.0, 3.0]
    motion = FourierTrajectory(speeds, pace, seconds)
    path = folder / "eight.json"
    path.write_text(motion.to_json())
    return path


def test_a_motion_of_ones_own_leaves_with_the_learned_drag(lab: Path, tmp_path: Path) -> None:
    """In the receiver's controller the exported set-points leave a third of what the motion's own leave."""
    table, drag = exported(lab, eight(tmp_path), tmp_path / "out")
    assert np.abs(drag).max() > 1.0
    plain = table.copy()
    plain[:, 6:9] -= drag
    told, own = (fly(rows, controller=Geometric, seed=7).error(4.0) for rows in (table, plain))
    assert told <= 0.10
    assert told < 0.4 * own


def test_the_certificate_is_of_the_motion_and_says_so(lab: Path, tmp_path: Path) -> None:
    exported(lab, eight(tmp_path), tmp_path / "out")
    proof = json.loads((tmp_path / "out" / "px4" / "certificate.json").read_text())
    (said,) = proof["notes"]
    assert "commands, not the motion" in said
    assert proof["ok"]
    files = {"setpoints.csv": (tmp_path / "out" / "px4" / "setpoints.csv").read_bytes()}
    played = plugins.load("etude.exporters", "px4").back(files)
    motion = from_json((tmp_path / "out" / "trajectory.json").read_bytes())
    np.testing.assert_allclose(played.points, motion.motion(played.times, 3).orders, atol=1e-5)


def test_asked_set_points_hold_against_the_drag_once_it_is_learned(lab: Path) -> None:
    first, _ = table_of(lab / "proposals" / "0001" / "px4" / "setpoints.csv")
    _, before = table_of(lab / "proposals" / "0001" / "px4" / "setpoints.csv")
    table, after = table_of(lab / "proposals" / "0002" / "px4" / "setpoints.csv")
    assert not before.any()
    assert len(first)
    assert np.abs(after).max() > 0.3
    lateral = np.einsum("ij,ij->i", table[:, 3:5], after[:, :2])
    moving = np.linalg.norm(table[:, 3:5], axis=1) > 1.0
    assert (lateral[moving] > 0.0).all()  # against the drag is along the velocity


def test_the_commands_along_a_motion_hold_the_accelerations_too(lab: Path, tmp_path: Path) -> None:
    table, _ = exported(lab, eight(tmp_path), tmp_path / "out")
    rows = np.genfromtxt(tmp_path / "out" / "commands.csv", delimiter=",", names=True)
    told = np.column_stack([rows[f"a{axis}_command"] for axis in "xyz"])
    moves = table[: len(told), 3:6].any(axis=1)  # rows at rest are held, and are rest to the bit
    assert moves.mean() > 0.99
    np.testing.assert_allclose(told[moves], table[: len(told), 6:9][moves], atol=2e-5)
