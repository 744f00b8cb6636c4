"""What is written is what was certified, at any speed, for every kind of robot."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import etude.deploy.trajectory_files as module
from certificate_schema import valid
from etude import plugins
from etude.deploy import csv_bytes, read_table
from etude.deploy.trajectory_files import (
    SPEEDS,
    TrajectoryFiles,
    at_speed,
    column_names,
    lines,
    render,
    table_rate,
)
from etude.design import Source
from etude.errors import UnsafeTrajectoryError, UsageError
from etude.limits import COLLISIONS, certify
from etude.models import ModelConfig
from etude.protocols import Kind, Limit, Trajectory
from etude.trajectories import from_json
from etude.types import Channel

ROBOT = """\
name = "two"
command_unit = "N m"
rate = 50.0
[[axis]]
name = "a"
lower = -1.0
upper = 1.0
velocity = 0.5
acceleration = 2.0
command = 10.0
[[axis]]
name = 'b, "left"'
lower = 0.0
upper = 2.0
velocity = 1.0
acceleration = 1.0
command = 20.0
"""


@dataclass(frozen=True)
class Case:
    """A robot, its configuration and a random trajectory inside its limits."""

    kind: Kind
    spec: Any
    config: Any
    limits: tuple[Limit, ...]
    trajectory: Any

    def render(self, trajectory: Trajectory | None = None) -> TrajectoryFiles:
        return render(trajectory or self.trajectory, self.kind, self.spec, self.config, self.limits)

    def table(self) -> tuple[list[str], np.ndarray]:  # type: ignore[type-arg]
        inputs = self.kind.inputs(self.spec, self.config)
        return read_table(csv_bytes(self.trajectory, inputs, table_rate(self.spec)))


@dataclass(frozen=True)
class Tables:
    """What a kind asks of a campaign's configuration."""

    trajectory: Any
    data: Any
    model: ModelConfig = field(default_factory=ModelConfig)


def case(name: str, path: Path, **trajectory: Any) -> Case:
    kind: Kind = plugins.load("etude.robots", name)
    config = Tables(kind.tables["trajectory"](**trajectory), kind.tables["data"]())
    spec = kind.spec(path)
    limits = tuple(kind.limits(spec, config, None, {}))
    source = Source(kind.family(spec, config), limits, kind.home(spec), "uniform")
    return Case(kind, spec, config, limits, source.typical(np.random.default_rng(3), 1)[0].trajectory)


@pytest.fixture(params=["nullspace", "ramp"])
def arm(request: pytest.FixtureRequest, tmp_path: Path) -> Case:
    path = tmp_path / "two.toml"
    path.write_text(ROBOT)
    if request.param == "nullspace":
        return case("arm", path, duration=20.0)
    return case("arm", path, harmonics=2, duration=20.0, omega0=0.5, rest="ramp", ramp=1.5)


@pytest.fixture
def flight() -> Case:
    kind = plugins.load("etude.robots", "quadrotor")
    return case("quadrotor", kind.built_in()["quadrotor"], duration=12.0)


@pytest.fixture(params=["arm", "flight"])
def any_case(request: pytest.FixtureRequest) -> Case:
    if request.param == "flight":
        return request.getfixturevalue("flight")
    kind = plugins.load("etude.robots", "arm")
    return case("arm", kind.built_in()["arm4"], duration=20.0, omega0=2 * np.pi / 20.0)


def test_the_written_bytes_are_certified(any_case: Case, tmp_path: Path) -> None:
    files = any_case.render()
    paths = files.write(tmp_path / "p")
    assert [p.name for p in paths] == ["trajectory.json", "trajectory.csv", "certificate.json"]
    assert from_json(paths[0].read_bytes()) == any_case.trajectory
    proof = valid(paths[2].read_text())
    assert (proof["ok"], proof["robot"]) == (True, any_case.spec.name)
    assert min(row["slack"] for row in proof["rows"]) >= 0
    assert COLLISIONS in proof["not_verified"]
    assert any("The tracking error" in sentence for sentence in proof["not_verified"])


def test_the_table_of_an_arm_is_its_trajectory(arm: Case) -> None:
    header, rows = arm.table()
    names = ["a", 'b, "left"']
    assert header == ["time", *(f"{kind}_{name}" for kind in ("q", "qd", "qdd") for name in names)]
    assert len(rows) == 1001
    motion = arm.trajectory.motion(rows[:, 0], 3)
    np.testing.assert_array_equal(rows[:, 1:], np.hstack(motion.orders))


def test_the_table_of_a_flight_is_what_an_autopilot_takes(flight: Case) -> None:
    header, rows = flight.table()
    expected = "time,x,y,z,vx,vy,vz,ax,ay,az,roll,pitch,yaw,wx,wy,wz,thrust"
    assert header == expected.split(",")
    assert len(rows) == 601
    motion = flight.trajectory.motion(rows[:, 0], 3)
    np.testing.assert_array_equal(rows[:, 1:10], np.hstack(motion.orders))
    force = motion.orders[2] + [0.0, 0.0, 9.81]
    np.testing.assert_allclose(rows[:, -1], np.linalg.norm(force, axis=1), rtol=1e-3)


def test_columns_of_other_channels_carry_their_names() -> None:
    assert column_names(Channel("q_des", ("lift",), ("m",))) == ["q_lift"]
    assert column_names(Channel("velocity_des", ("x", "y"), ("m/s",) * 2)) == ["vx", "vy"]
    assert column_names(Channel("grip", ("jaw",), ("m",))) == ["grip_jaw"]


def test_an_unsafe_trajectory_has_no_files(any_case: Case) -> None:
    good = any_case.trajectory
    with pytest.raises(UnsafeTrajectoryError, match=r"may reach"):
        any_case.render(replace(good, coefficients=good.coefficients * 2.5))


def test_a_table_outside_the_limits_is_noticed(any_case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """A peer's mistake: verified the design, then wrote another file."""
    real = csv_bytes

    def wrong(*arguments: Any) -> bytes:
        return re.sub(rb"\n([^,]*),([^,]*)((?:,[^\n]*)\n[^\n]*)\Z", rb"\n\1,99.0\3", real(*arguments))

    monkeypatch.setattr(module, "csv_bytes", wrong)
    with pytest.raises(UnsafeTrajectoryError, match=r"row \d+ of the table"):
        any_case.render()


def test_a_table_of_another_motion_is_noticed(any_case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """A millionth beside its motion: no limit sees that."""
    real = csv_bytes

    def wrong(*arguments: Any) -> bytes:
        head, row = real(*arguments).rstrip().rsplit(b"\n", 1)
        cells = row.split(b",")
        cells[1] = repr(float(cells[1]) * (1.0 - 1e-6) - 1e-6).encode()
        return head + b"\n" + b",".join(cells)

    monkeypatch.setattr(module, "csv_bytes", wrong)
    with pytest.raises(UnsafeTrajectoryError, match=r"row \d+ of the table leaves the motion"):
        any_case.render()


def test_a_table_that_is_no_number_is_noticed(any_case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    real = csv_bytes
    monkeypatch.setattr(module, "csv_bytes", lambda *a: re.sub(rb",[^,\n]*\Z", b",nan", real(*a).strip()))
    with pytest.raises(UnsafeTrajectoryError, match=r"row \d+ of the table"):
        any_case.render()


@pytest.mark.parametrize("per_cent", SPEEDS)
def test_slower_is_the_same_path(arm: Case, per_cent: int) -> None:
    slow, s = at_speed(arm.trajectory, per_cent), per_cent / 100
    t = np.linspace(0, arm.trajectory.duration, 301)
    fast, now = arm.trajectory.motion(t, 3).orders, slow.motion(t / s, 3).orders
    for order in range(3):
        np.testing.assert_allclose(now[order], fast[order] * s**order, atol=1e-12)
    assert certify(slow, arm.limits).ok
    assert slow.duration == arm.trajectory.duration / s


@pytest.mark.parametrize("per_cent", [0, -25, 101, float("nan")])
def test_impossible_speeds_are_refused(arm: Case, per_cent: float) -> None:
    with pytest.raises(UsageError, match="per cent"):
        at_speed(arm.trajectory, per_cent)


def test_numbers_are_written_as_python_writes_them() -> None:
    """Around all exponents at which it changes its mind, zeros of both signs, and what is not finite."""
    rng = np.random.default_rng(0)
    exponents = rng.integers(-30, 30, (2000, 5))
    rows = rng.standard_normal((2000, 5)) * 10.0**exponents
    rows[::7] = rng.standard_normal((len(rows[::7]), 5))
    edges = [0.0, -0.0, 1e-4, np.nextafter(1e-4, 0.0), 1e16, np.nextafter(1e16, 0.0), 5e-324, np.nan, -np.inf]
    rows[:9, 2], rows[20:29] = edges, np.array(edges)[:, None]
    expected = "".join(",".join(map(repr, row)) + "\n" for row in rows.tolist())
    assert lines(rows) == expected
    assert lines(rows[:1]) == expected[: len(lines(rows[:1]))]
    assert lines(np.zeros((0, 3))) == ""
