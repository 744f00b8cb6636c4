"""What is written is what was certified, at any speed."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from etude.deploy.trajectory_files import SPEEDS, at_speed, csv_bytes, read_table, render
from etude.errors import UnsafeTrajectoryError, UsageError
from etude.robots.spec import Axis, RobotSpec
from etude.trajectories.certificate import certify
from etude.trajectories.family import TrajectoryFamily
from etude.trajectories.fourier import FourierTrajectory
from etude.trajectories.moves import random_moves
from etude.trajectories.random import random_trajectory
from etude.trajectories.trajectory_file import from_json

SPEC = RobotSpec("two", (Axis("a", -1, 1, 0.5, 2, 10), Axis("b", 0, 2, 1, 1, 20)), "N m", 50.0)
FAMILIES = [
    TrajectoryFamily(duration=20.0),
    TrajectoryFamily(harmonics=2, duration=20.0, omega0=0.5, rest="ramp", ramp=1.5),
]


@pytest.fixture(params=FAMILIES, ids=["nullspace", "ramp"])
def trajectory(request: pytest.FixtureRequest) -> FourierTrajectory:
    return random_trajectory(np.random.default_rng(3), SPEC, request.param)


def test_the_written_bytes_are_certified(trajectory: FourierTrajectory, tmp_path: Path) -> None:
    files = render(trajectory, SPEC)
    paths = files.write(tmp_path / "p")
    assert [p.name for p in paths] == ["trajectory.json", "trajectory.csv", "certificate.json"]
    assert from_json(paths[0].read_bytes()) == trajectory
    proof = json.loads(paths[2].read_text())
    assert proof["ok"] is True
    assert min(row["margin"] for row in proof["rows"]) >= 0
    assert len(proof["rows"]) == 6


def test_the_table_is_the_trajectory(trajectory: FourierTrajectory) -> None:
    header, rows = read_table(csv_bytes(trajectory, SPEC))
    assert header == ["time", "q_a", "q_b", "qd_a", "qd_b", "qdd_a", "qdd_b"]
    assert len(rows) == 1001
    s = trajectory.sample(rows[:, 0])
    np.testing.assert_array_equal(rows[:, 1:], np.hstack([s.q, s.qd, s.qdd]))


def test_moves_are_written_too(tmp_path: Path) -> None:
    moves = random_moves(np.random.default_rng(0), SPEC, 3)
    render(moves, SPEC).write(tmp_path)
    assert from_json((tmp_path / "trajectory.json").read_bytes()).duration == moves.duration


def test_an_unsafe_trajectory_has_no_files(trajectory: FourierTrajectory) -> None:
    wild = replace(trajectory, coefficients=trajectory.coefficients * 1.5)
    with pytest.raises(UnsafeTrajectoryError, match=r"of joint '[ab]' may reach"):
        render(wild, SPEC)


def test_a_table_outside_the_limits_is_noticed(
    trajectory: FourierTrajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A peer's mistake: verified the design, then wrote another file."""
    import etude.deploy.trajectory_files as module

    wrong = re.sub(rb"\n0\.02,[^,]*", b"\n0.02,9.0", csv_bytes(trajectory, SPEC))
    monkeypatch.setattr(module, "csv_bytes", lambda *_: wrong)
    with pytest.raises(UnsafeTrajectoryError, match=r"row 3 of the table"):
        render(trajectory, SPEC)


@pytest.mark.parametrize("per_cent", SPEEDS)
def test_slower_is_the_same_path(trajectory: FourierTrajectory, per_cent: int) -> None:
    slow, s = at_speed(trajectory, per_cent), per_cent / 100
    t = np.linspace(0, trajectory.duration, 301)
    fast, now = trajectory.sample(t), slow.sample(t / s)
    np.testing.assert_allclose(now.q, fast.q, atol=1e-12)
    np.testing.assert_allclose(now.qd, fast.qd * s, atol=1e-12)
    np.testing.assert_allclose(now.qdd, fast.qdd * s**2, atol=1e-12)
    assert certify(slow, SPEC).ok
    assert slow.duration == trajectory.duration / s


@pytest.mark.parametrize("per_cent", [0, -25, 101, float("nan")])
def test_impossible_speeds_are_refused(trajectory: FourierTrajectory, per_cent: float) -> None:
    with pytest.raises(UsageError, match="per cent"):
        at_speed(trajectory, per_cent)
