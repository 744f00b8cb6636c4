"""joint_trajectory_controller of ros2_controllers, as its documentation and source describe it.

Nothing of Étude is imported. Source: https://github.com/ros-controls/ros2_controllers, release 4 (Jazzy) and
later: `joint_trajectory_controller/src/trajectory.cpp`, `joint_trajectory_controller.cpp` (`update`,
`validate_trajectory_msg`, `set_success_trajectory_point`), its parameters' YAML and `doc/trajectory.rst`.
"""

from __future__ import annotations

import bisect
import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
FLOAT_EPSILON = float(np.finfo(np.float32).eps)
"""Largest speed of the last point that is taken for zero: numeric_limits<float>::epsilon()."""


class RejectedError(Exception):
    """The controller's reason to take no goal."""


@dataclass(frozen=True)
class Point:
    """trajectory_msgs/JointTrajectoryPoint; an empty field was not given. SI, nanoseconds from the start."""

    nanoseconds: int
    positions: tuple[float, ...]
    velocities: tuple[float, ...] = ()
    accelerations: tuple[float, ...] = ()
    effort: tuple[float, ...] = ()


@dataclass(frozen=True)
class Message:
    """trajectory_msgs/JointTrajectory with a stamp of zero: start now."""

    joint_names: tuple[str, ...]
    points: tuple[Point, ...]


@dataclass(frozen=True)
class Parameters:
    """The documented parameters, with their documented defaults. A tolerance of 0 is not checked.

    Attributes:
        effort_interface: whether `command_interfaces` holds effort; without it effort is refused.
        path, goal: rad (m), `constraints.<joint>.trajectory` and `.goal`.
        goal_time: s; 0 waits for ever.
    """

    joints: tuple[str, ...]
    allow_partial_joints_goal: bool = False
    allow_nonzero_velocity_at_trajectory_end: bool = False
    interpolate_from_desired_state: bool = False
    effort_interface: bool = False
    path: float = 0.0
    goal: float = 0.0
    goal_time: float = 0.0


@dataclass(frozen=True)
class Desired:
    """One sample of what the controller commands."""

    positions: Array
    velocities: Array
    accelerations: Array
    effort: Array


def validate(message: Message, parameters: Parameters) -> None:
    """`validate_trajectory_msg`. RejectedError: with the first check that failed."""
    names, points = message.joint_names, message.points
    if not parameters.allow_partial_joints_goal and len(names) != len(parameters.joints):
        raise RejectedError("Joints on incoming trajectory don't match the controller joints.")
    if not names:
        raise RejectedError("Empty joint names on incoming trajectory.")
    if not points:
        raise RejectedError("Empty trajectory received.")
    for name in names:
        if name not in parameters.joints:
            raise RejectedError(f"Incoming joint {name} doesn't match the controller's joints.")
    if not parameters.allow_nonzero_velocity_at_trajectory_end:
        for name, speed in zip(names, points[-1].velocities, strict=False):
            if abs(speed) > FLOAT_EPSILON:
                raise RejectedError(f"Velocity of last trajectory point of joint {name} is not zero: {speed}")
    for i, point in enumerate(points):
        if i > 0 and point.nanoseconds <= points[i - 1].nanoseconds:
            raise RejectedError(f"Time between points {i - 1} and {i} is not strictly increasing")
        for word, may_be_empty in (("positions", False), ("velocities", True), ("accelerations", True)):
            row = getattr(point, word)
            if len(row) != len(names) and not (may_be_empty and not row):
                raise RejectedError(f"Mismatch between joint_names size and {word} at point #{i}.")
        if point.effort and not parameters.effort_interface:
            raise RejectedError(
                "Trajectories with effort fields are only supported with the 'effort' interface."
            )


def between(a: Point, b: Point, seconds: float) -> Desired:
    """`interpolate_between_points`, that many s after a: lines, cubics or quintics; effort by lines."""
    powers, whole, effort = _polynomial(a, b)
    place, i = seconds ** np.arange(len(powers)), np.arange(len(powers))
    value, first = place @ powers, (i[1:] * place[:-1]) @ powers[1:]
    second = (i[2:] * i[1:-1] * place[:-2]) @ powers[2:]
    share = seconds / whole if whole else 0.0
    return Desired(value, first, second, (1.0 - share) * effort[0] + share * effort[1])


@lru_cache(maxsize=4)  # cycles are many between two points
def _polynomial(a: Point, b: Point) -> tuple[Array, float, Array]:
    """Coefficients (n, J) of 1, t, ... from a to b, the s between them, and the efforts (2, J) of both."""
    whole = (b.nanoseconds - a.nanoseconds) * 1e-9
    order = 2 if a.accelerations and b.accelerations and a.velocities and b.velocities else 0
    order = order or (1 if a.velocities and b.velocities else 0)
    rows = [[np.array(p.positions), np.array(p.velocities), np.array(p.accelerations)] for p in (a, b)]
    start, end = (row[: order + 1] for row in rows)
    effort = np.array([a.effort, b.effort]) if a.effort and b.effort else np.zeros((2, len(a.positions)))
    return np.array(_hermite(start, end, whole)), whole, effort


def _hermite(start: Sequence[Array], end: Sequence[Array], whole: float) -> list[Array]:
    """Coefficients of 1, t, ..., of the polynomial with these orders at 0 and at `whole` s."""
    n = len(start)
    known = [row / math.factorial(i) for i, row in enumerate(start)]
    if whole == 0.0:
        return known
    rows, right = np.zeros((n, n)), []
    for order in range(n):
        for j in range(n):
            rows[order, j] = math.perm(n + j, order) * whole ** (n + j - order)
        right.append(
            end[order] - sum(math.perm(i, order) * known[i] * whole ** (i - order) for i in range(order, n))
        )
    return [*known, *np.linalg.solve(rows, np.stack(right))]


@dataclass
class Controller:
    """`JointTrajectoryController`: `accept` a goal, then `update` at each cycle.

    Attributes:
        parameters: its own.
        aborted: why it holds, "" while it does not.
        reached: whether the goal was reported as reached.
    """

    parameters: Parameters
    aborted: str = ""
    reached: bool = False
    _message: Message | None = None
    _start: float | None = None
    _before: tuple[float, Point] | None = None
    _last: Desired | None = None
    _times: list[float] = field(default_factory=list)

    def accept(self, message: Message) -> None:
        """Takes a goal, in the controller's order of joints. RejectedError: see `validate`."""
        validate(message, self.parameters)
        place = [message.joint_names.index(name) for name in self.parameters.joints]

        def own(row: tuple[float, ...]) -> tuple[float, ...]:
            return tuple(row[i] for i in place) if row else ()

        points = tuple(
            Point(p.nanoseconds, own(p.positions), own(p.velocities), own(p.accelerations), own(p.effort))
            for p in message.points
        )
        self._message, self._start = Message(self.parameters.joints, points), None
        self._times = [p.nanoseconds * 1e-9 for p in points]
        self.aborted, self.reached = "", False

    def update(self, time: float, positions: Array, velocities: Array) -> Desired:
        """One cycle at `time` s with the measured state; holds where it is until there is a goal."""
        if self._message is None:
            # a controller without goal holds the pose at which it was activated
            self._last = self._last or _still(positions)
            return self._last
        if self._start is None:
            self._start = time
            state = Point(0, tuple(positions), tuple(velocities))
            if self.parameters.interpolate_from_desired_state and self._last is not None:
                last = self._last
                state = Point(0, tuple(last.positions), tuple(last.velocities), tuple(last.accelerations))
            self._before = (time, state)
        found = self._sample(time - self._start)
        error = float(np.abs(positions - found.positions).max())
        self._judge(time - self._start, error)
        if self.aborted:
            self._message = Message(self.parameters.joints, (Point(0, tuple(positions)),))
            self._times, self._start = [0.0], time
            found = _still(positions)
        self._last = found
        return found

    def _judge(self, seconds: float, error: float) -> None:
        own, end = self.parameters, self._times[-1]
        if self.reached or self.aborted:
            return
        if seconds < end:
            if own.path > 0.0 and error > own.path:
                self.aborted = "Aborted due to path tolerance violation"
        elif not (own.goal > 0.0 and error > own.goal):
            self.reached = True
        elif own.goal_time > 0.0 and seconds - end > own.goal_time:
            self.aborted = "Aborted due to goal_time_tolerance exceeding"

    def _sample(self, seconds: float) -> Desired:
        assert self._message is not None
        assert self._before is not None
        points = self._message.points
        if seconds < self._times[0]:  # from where it is to a first point that lies in the future
            state = self._before[1]
            return between(state, points[0], seconds)
        i = bisect.bisect_right(self._times, seconds) - 1
        if i < len(points) - 1:
            return between(points[i], points[i + 1], seconds - self._times[i])
        # after the last point all of it is repeated, "no matter if it has nonzero velocity or acceleration"
        last = points[-1]
        none = (0.0,) * len(last.positions)
        rows = [last.positions, *(row or none for row in (last.velocities, last.accelerations, last.effort))]
        return Desired(*(np.array(row) for row in rows))


def _still(positions: Array) -> Desired:
    none = np.zeros(len(positions))
    return Desired(np.array(positions, dtype=float), none, none, none)


@dataclass(frozen=True)
class Played:
    """What the controller commanded, and when: s from the goal's acceptance, negative before.

    Attributes:
        t: (T,) s. q, qd, qdd: (T, J). effort: (T, J) N m.
    """

    t: Array
    q: Array
    qd: Array
    qdd: Array
    effort: Array


def play(
    message: Message,
    parameters: Parameters,
    start: Array | None = None,
    before: float = 10.0,
    after: float = 10.0,
    rate: float = 1000.0,
) -> Played:
    """What is commanded from `before` s before the goal to `after` s after its last point.

    Args:
        start: (J,) where the robot stands; None: at the first point. It follows without error.
    """
    controller = Controller(parameters)
    first = [message.points[0].positions[message.joint_names.index(name)] for name in parameters.joints]
    q = np.array(first if start is None else start, dtype=float)
    qd = np.zeros(len(q))
    count = math.ceil(before * rate)
    duration = message.points[-1].nanoseconds * 1e-9
    t = (np.arange(count + math.ceil((duration + after) * rate) + 1) - count) / rate
    rows = []
    for i, now in enumerate(t.tolist()):
        if i == count:
            controller.accept(message)
        found = controller.update(now, q, qd)
        q, qd = found.positions, found.velocities
        rows.append((found.positions, found.velocities, found.accelerations, found.effort))
    columns = [np.stack(column) for column in zip(*rows, strict=True)]
    return Played(t, *columns)


def message_of(name: str, files: Mapping[str, bytes]) -> Message:
    """The goal in the bytes of `ros2_yaml`, `ros2_csv`, `ros2` and `ros2_sqlite`, read without Étude."""
    if name == "ros2_yaml":
        return _of_yaml(files["joint_trajectory.yaml"])
    if name == "ros2_csv":
        return _of_table(files["points.csv"])
    return _of_bag(files)


def _of_yaml(data: bytes) -> Message:
    text = "\n".join(line for line in data.decode().splitlines() if not line.startswith("#"))
    content = json.loads(text)
    points = []
    for point in content["points"]:
        rows = [tuple(map(float, point.get(word, ()))) for word in _FIELDS]
        time = point["time_from_start"]
        points.append(Point(int(time["sec"]) * 10**9 + int(time["nanosec"]), *rows))
    return Message(tuple(content["joint_names"]), tuple(points))


_FIELDS = ("positions", "velocities", "accelerations", "effort")


def _of_table(data: bytes) -> Message:
    header, *rows = csv.reader(io.StringIO(data.decode()))
    words = ("position", "velocity", "acceleration", "effort")
    columns = [[i for i, name in enumerate(header) if name.startswith(word + "/")] for word in words]
    names = tuple(header[i].partition("/")[2] for i in columns[0])
    points = [Point(int(row[0]), *(tuple(float(row[i]) for i in part) for part in columns)) for row in rows]
    return Message(names, tuple(points))


def _of_bag(files: Mapping[str, bytes]) -> Message:
    import tempfile
    from pathlib import Path

    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with tempfile.TemporaryDirectory() as place:
        for path, content in files.items():
            file = Path(place) / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
        with AnyReader(
            [Path(place) / "motion"], default_typestore=get_typestore(Stores.ROS2_JAZZY)
        ) as reader:
            for connection, _, raw in reader.messages():
                if connection.msgtype == "trajectory_msgs/msg/JointTrajectory":
                    return _of_ros(reader.deserialize(raw, connection.msgtype))
    raise RejectedError("the bag holds no JointTrajectory")


def _of_ros(message: Any) -> Message:
    points = []
    for p in message.points:
        time = p.time_from_start.sec * 10**9 + p.time_from_start.nanosec
        points.append(Point(time, *(tuple(getattr(p, word).tolist()) for word in _FIELDS)))
    return Message(tuple(message.joint_names), tuple(points))
