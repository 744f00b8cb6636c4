"""Every format: the laws of exporters, and what each receiver's own library reads of the bytes."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from etude import plugins
from etude.deploy import MotionWithCommands, certify_played
from etude.deploy.exporters.joint_trajectory import _number
from etude.deploy.exporters.knots import grid_of
from etude.errors import UnsafeTrajectoryError, UsageError
from etude.limits import AxisLimit
from etude.testing import ExporterSuite, World, world
from etude.trajectories import PointToPoint

ARM, VEHICLE = (plugins.load("etude.robots", name) for name in ("arm", "quadrotor"))
ACCURACY = {"lerobot": 1e-4, "urscript": 1e-5, "urscript_cb": 1e-4, "px4": 0.1, "crazyflie": 1e-4}
"""Lines of single precision, of 2 and of 8 ms; steps held for 20 ms; 31 pieces."""
SPACE = ("px4", "crazyflie")
SIX_JOINTS = ("urscript", "urscript_cb")
UR10 = Path(__file__).parents[3] / "examples" / "ur10" / "ur10.toml"
NAMES = plugins.names("etude.exporters")
pytestmark = pytest.mark.filterwarnings("error")


def exporter(name: str) -> Any:
    if name in ("ros2", "ros2_sqlite"):
        pytest.importorskip("rosbags", reason="bags are written by the extra 'ros'")
    return plugins.load("etude.exporters", name)


def robot_of(name: str) -> str:
    return "quadrotor" if name in SPACE else str(UR10) if name in SIX_JOINTS else "arm4"


def here(name: str) -> World:
    return world(VEHICLE if name in SPACE else ARM, robot_of(name))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("law", [law for law in dir(ExporterSuite) if law.startswith("test_")])
def test_laws(name: str, law: str) -> None:
    own = exporter(name)

    class Suite(ExporterSuite):
        kind, robot = here(name).kind, robot_of(name)
        accuracy: ClassVar[float] = ACCURACY.get(name, 1e-6)

    Suite.exporter = own
    getattr(Suite(), law)()


@pytest.mark.parametrize("name", NAMES)
def test_a_robot_of_the_other_sort_is_refused(name: str) -> None:
    other = here("ros2" if name in SPACE else "px4")
    with pytest.raises(UsageError, match=r"x, y, z"):
        exporter(name)(other.trajectory(0), other.kind, other.spec)


def moves(axes: int, speed: float = 1.0, reach: float = 1.0) -> PointToPoint:
    points = reach * np.array([[0.0] * axes, [1.0] * axes, [-0.5] * axes])
    return PointToPoint(points, speed, 0.5)


def spec(*names: str) -> Any:
    """A robot of joints with these names."""
    from etude_arm import ArmSpec, Axis

    axes = tuple(Axis(name, -2.0, 2.0, 3.0, 30.0, 5.0) for name in names)
    return ArmSpec("named", axes, "N m", 100.0)


ODD = ("on", "1e3", 'a "b", c', "no")


@pytest.mark.parametrize("name", ["ros2", "ros2_sqlite"])
def test_another_reader_finds_the_message(name: str, tmp_path: Any) -> None:
    own = exporter(name)
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    motion = moves(4)
    files = own(
        MotionWithCommands(motion, lambda t: np.outer(np.cos(t), [1.0, 2.0, 3.0, 4.0])), ARM, spec(*ODD)
    )
    folder = tmp_path / "motion"
    folder.mkdir()
    for path, data in files.items():
        (tmp_path / path).write_bytes(data)
    with AnyReader([folder], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        ((connection, _, raw),) = reader.messages()
        message = reader.deserialize(raw, connection.msgtype)
    assert tuple(message.joint_names) == ODD
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (0, 0)
    times = [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in message.points]
    assert times[0] == 0.0
    assert np.diff(times).min() > 0.0
    assert times[-1] == pytest.approx(motion.duration, abs=1e-9)
    for point, t in zip(message.points, times, strict=True):
        exact = motion.motion(np.array([t]), 3).orders[:, 0]
        for row, field in zip(exact, ("positions", "velocities", "accelerations"), strict=True):
            np.testing.assert_allclose(getattr(point, field), row, atol=1e-6)
        np.testing.assert_allclose(point.effort, math.cos(t) * np.arange(1.0, 5.0), atol=1e-9)
    assert not message.points[-1].velocities.any()


def test_without_a_command_the_effort_is_empty() -> None:
    text = exporter("ros2_yaml")(moves(1), ARM, spec("a"))["joint_trajectory.yaml"].decode()
    assert "effort" not in text


def test_yaml_1_1_reads_every_float_and_every_name() -> None:
    yaml = pytest.importorskip("ruamel.yaml", reason="comes with the extra 'ros'")
    own = exporter("ros2_yaml")
    motion = moves(4, 1e-6, 1e-6)  # so small that positions are written with exponents
    files = own(motion, ARM, spec(*ODD))
    reader = yaml.YAML(typ="safe", pure=True)
    reader.version = (1, 1)
    content = reader.load(files["joint_trajectory.yaml"].decode())
    assert tuple(content["joint_names"]) == ODD
    numbers = [v for p in content["points"] for f in ("positions", "accelerations") for v in p[f]]
    assert all(isinstance(v, float) for v in numbers)
    assert any(0.0 < abs(v) < 1e-5 for v in numbers)
    played = own.back(files)
    np.testing.assert_array_equal(played.points[0], [p["positions"] for p in content["points"]])


@pytest.mark.parametrize("value", [1e-5, -2e-300, 1e22, 0.1, 5e-324, -0.0, 123456789.0])
def test_a_number_has_a_point_and_reads_back(value: float) -> None:
    text = _number(value)
    assert "." in text
    assert float(text) == value


def test_pieces_of_a_motion_begin_and_end_at_points() -> None:
    class Chained:
        duration = 7.0

        def pieces(self):
            return [
                (0.0, "segment", SimpleNamespace(duration=math.pi)),
                (4.0, "link", SimpleNamespace(duration=3.0)),
            ]

    grid = grid_of(Chained(), 10.0) / 1e9  # type: ignore[arg-type]
    for edge in (0.0, math.pi, 4.0, 7.0):
        assert np.abs(grid - edge).min() < 1e-9
    assert np.diff(grid).max() <= 0.1 + 1e-9


def test_a_crazyflie_s_memory_is_not_exceeded() -> None:
    own, place = exporter("crazyflie"), here("crazyflie")
    rows = list(
        csv.reader(io.StringIO(own(place.trajectory(3), place.kind, place.spec)["poly4d.csv"].decode()))
    )
    assert len(rows) == 31 + 1
    assert [len(row) for row in rows] == [33] * len(rows)
    wild = PointToPoint(np.random.default_rng(0).uniform(-1.0, 1.0, (40, 3)), 1.0, 0.0)
    with pytest.raises(UsageError, match="31 pieces"):
        own(wild, place.kind, place.spec)


def test_polynomials_that_do_not_meet_are_refused() -> None:
    own, place = exporter("crazyflie"), here("crazyflie")
    text = own(place.trajectory(3), place.kind, place.spec)["poly4d.csv"].decode()
    lines = text.splitlines()
    cells = lines[5].split(",")
    cells[1] = repr(float(cells[1]) + 0.01)
    lines[5] = ",".join(cells)
    with pytest.raises(UsageError, match="miss each other"):
        own.back({"poly4d.csv": "\n".join(lines).encode()})


def test_px4_flies_north_east_down() -> None:
    own, place = exporter("px4"), here("px4")
    motion = place.trajectory(2)
    rows = list(csv.DictReader(io.StringIO(own(motion, place.kind, place.spec)["setpoints.csv"].decode())))
    t = np.array([float(row["time"]) for row in rows])[:-1]
    east, north, up = motion.motion(t, 1).orders[0].T
    for name, values in (("north", north), ("east", east), ("down", -up)):
        np.testing.assert_allclose([float(row[name]) for row in rows[:-1]], values, atol=1e-6)
    np.testing.assert_allclose(np.diff(t), 0.02, atol=1e-12)
    assert {row["yaw"] for row in rows} == {repr(0.5 * math.pi)}


def test_lerobot_s_reader_here_finds_the_motion(tmp_path: Any) -> None:
    place, own = here("lerobot"), exporter("lerobot")
    motion = place.trajectory(1)
    for path, data in own(motion, place.kind, place.spec).items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_bytes(data)
    (log,) = plugins.load("etude.readers", "lerobot")(tmp_path).values()
    found = np.stack([log["position_desired/" + name][:, 0] for name in place.spec.names], axis=1)
    np.testing.assert_allclose(
        np.deg2rad(found), motion.motion(log["timestamp"][:, 0], 1).orders[0], atol=1e-5
    )


def test_what_the_receiver_plays_outside_a_limit_is_refused() -> None:
    own, motion = exporter("ros2_yaml"), moves(1)
    files = own(motion, ARM, spec("a"))
    peak = np.abs(motion.motion(np.linspace(0.0, motion.duration, 9001), 2).orders[1]).max()
    near = [
        AxisLimit("velocity", 1, ("a",), -np.array([peak * f]), np.array([peak * f])) for f in (1.01, 0.99)
    ]
    assert certify_played(own, files, near[:1], motion).ok
    with pytest.raises(UnsafeTrajectoryError, match=r"as its receiver plays it, velocity of 'a'"):
        certify_played(own, files, near[1:], motion)


def test_what_lines_cannot_keep_is_a_row_that_nobody_looked_at() -> None:
    own, place = exporter("lerobot"), here("lerobot")
    motion = place.trajectory(1)
    found = certify_played(own, own(motion, place.kind, place.spec), place.limits, motion)
    (row,) = [row for row in found.rows if row.status == "not verified"]
    assert (row.quantity, row.method) == ("acceleration", "nothing bounds derivative 2 of lines")


def test_a_motion_that_is_too_quick_for_points_says_so() -> None:
    with pytest.raises(UsageError, match="too fast"):
        exporter("ros2_yaml")(moves(1, 3000.0).slowed(0.01), ARM, spec("a"))
