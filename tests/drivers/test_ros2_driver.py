"""The driver `ros2` over a controller of the tests, and its messages over DDS where that is installed."""

from __future__ import annotations

import importlib.util
import threading
import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from etude.drivers import Ended, PlannedMotion, Reaction, Sample, planned
from etude.errors import UsageError
from etude.testing import DriverSuite
from etude.trajectories import PointToPoint
from etude.types import Array
from etude_drivers import DdsTopics, JointRow, Points, Ros2Controller

NAMES = ("elbow", "base")
SETTINGS = {"command_of": "measured", "gravity_in_command": True}


class Controller:
    """Follows the newest trajectory: until its start from where it is to its first point, then point by point
    with quintics; at 200 Hz of a clock of its own.
    """

    def __init__(self, deaf: bool = False) -> None:
        self.t, self.deaf, self.silent_from = 1_000.0, deaf, np.inf
        self.q, self.qd, self.qdd = np.array([0.4, -0.7]), np.zeros(2), np.zeros(2)
        self.points: Points | None = None
        self.sent: list[Points] = []

    def now(self) -> float:
        return self.t

    def open(self, wait: float) -> None:
        pass

    def close(self) -> None:
        pass

    def send(self, points: Points) -> None:
        self.sent.append(points)
        if not self.deaf:
            self.points, self.since = points, self.t
            self.start = self.q.copy(), self.qd.copy(), self.qdd.copy()

    def drop(self) -> None:
        pass

    def state(self, wait: float) -> JointRow | None:
        self.t += 0.005
        if self.points is not None:
            self.q, self.qd, self.qdd = self._followed(self.points)
        if self.t > self.silent_from:
            return None
        return JointRow(self.t, NAMES[::-1], self.q[::-1].copy(), self.qd[::-1].copy(), np.array([1.0, 2.0]))

    def reference(self) -> JointRow | None:
        return JointRow(self.t, NAMES, self.q, self.qd, np.zeros(0))

    def _followed(self, own: Points) -> tuple[Array, Array, Array]:
        s = self.t - own.starts
        if s < 0.0:
            first = own.q[0], own.qd[0], own.qdd[0]
            return quintic(self.start, first, self.t - self.since, own.starts - self.since)
        row = min(int(np.searchsorted(own.t, s, side="right")) - 1, len(own.t) - 2)
        ends = [(own.q[i], own.qd[i], own.qdd[i]) for i in (row, row + 1)]
        if s >= own.t[-1]:
            return own.q[-1], 0.0 * own.q[-1], 0.0 * own.q[-1]
        return quintic(ends[0], ends[1], s - own.t[row], own.t[row + 1] - own.t[row])


def quintic(start: Any, end: Any, u: float, h: float) -> tuple[Array, Array, Array]:
    powers = np.array([[h**k, k * h ** (k - 1), k * (k - 1) * h ** (k - 2)] for k in (3, 4, 5)]).T
    q, qd, qdd = start
    left = np.array([end[0] - q - h * qd - 0.5 * h * h * qdd, end[1] - qd - h * qdd, end[2] - qdd])
    c = np.linalg.solve(powers, left)
    at = np.array([[u**k, k * u ** (k - 1), k * (k - 1) * u ** (k - 2)] for k in (3, 4, 5)]).T @ c
    return q + u * qd + 0.5 * u * u * qdd + at[0], qd + u * qdd + at[1], qdd + at[2]


class TestRos2Controller(DriverSuite):
    joints = NAMES

    def driver(self) -> Ros2Controller:
        return Ros2Controller(NAMES, "arm_controller", SETTINGS, Controller(), real=False)


def motion() -> PlannedMotion:
    path = PointToPoint(
        np.array([[0.4, -0.7], [0.8, -0.3]]), 0.8, dwell=0.1, peak_acceleration=4.0, peak_jerk=1e3
    )
    text = path.to_json().encode()
    return planned(text, number=1, part="motion", speed=100, names=NAMES, joints=NAMES, rate=100.0)


def go(sample: Sample) -> Reaction:
    return Reaction.GO


def test_a_stop_leaves_the_motion_without_a_step() -> None:
    topics = Controller()
    seen: list[Array] = []

    def stops(sample: Sample) -> Reaction:
        seen.append(np.concatenate([topics.q, topics.qd]))
        return Reaction.STOP if sample.at is not None and sample.at > 0.3 else Reaction.GO

    with Ros2Controller(NAMES, "arm_controller", SETTINGS, topics, real=False) as robot:
        recording = robot.play(motion(), stops, "feedback")
    assert recording.ended is Ended.STOPPED
    jumps = np.abs(np.diff(seen, axis=0))
    assert jumps[:, :2].max() < 0.8 * 0.005 * 1.1
    assert jumps[:, 2:].max() < 10.0 * 0.005
    assert np.abs(topics.qd).max() < 1e-9
    np.testing.assert_allclose(recording.asked[-1], topics.q, atol=1e-6)


def test_a_controller_that_does_not_take_the_motion_is_a_fault() -> None:
    with Ros2Controller(NAMES, "arm_controller", SETTINGS, Controller(deaf=True), real=False) as robot:
        recording = robot.play(motion(), go, "feedback")
    assert recording.ended is Ended.FAULT
    assert "does not follow the motion" in recording.reason


def test_silence_is_a_lost_link_and_a_stop_is_sent() -> None:
    topics = Controller()
    topics.silent_from = topics.t + 0.9
    with Ros2Controller(NAMES, "arm_controller", SETTINGS, topics, real=False) as robot:
        recording = robot.play(motion(), go, "feedback")
    assert recording.ended is Ended.LOST
    assert len(topics.sent) == 2
    assert np.abs(topics.sent[1].qd[-1]).max() == 0.0


def test_what_is_not_stated_is_not_guessed() -> None:
    about = Ros2Controller(NAMES, "arm_controller", {}, Controller()).about()
    assert about.command_of is None
    assert about.gravity_in_command is None
    with pytest.raises(UsageError, match="no key colour"):
        Ros2Controller(NAMES, "arm_controller", {"colour": 1}, Controller())


DDS = importlib.util.find_spec("cyclonedds") is not None


@pytest.mark.skipif(DDS, reason="it is installed")
def test_the_library_that_lacks_is_named_itself() -> None:
    with pytest.raises(UsageError, match="needs cyclonedds"):
        DdsTopics("arm_controller", "joint_states", 0)


@pytest.mark.skipif(not DDS, reason="pip install cyclonedds")
def test_over_dds_a_motion_arrives_and_states_come_back() -> None:
    """The other side of the topics in the same process."""
    topics = DdsTopics("arm_controller", "joint_states", 77)
    there = other_side(topics)
    topics.open(10.0)
    own = motion()
    topics.send(Points(12.25, own.joints, own.t, own.q, own.qd, own.qdd))
    time.sleep(0.5)
    got = there.goal.take(1)[0]
    assert got.joint_names == list(NAMES)
    assert (got.header.stamp.sec, got.header.stamp.nanosec) == (12, 250_000_000)
    np.testing.assert_array_equal([point.positions for point in got.points], own.q)
    kinds = topics.types
    there.joints.write(kinds.JointState(kinds.Header(kinds.Time(1, 0), ""), list(NAMES), [9.0, 9.0], [], []))
    time.sleep(0.3)
    topics.drop()
    rows: list[JointRow | None] = []
    listens = threading.Thread(target=lambda: rows.append(topics.state(5.0)))
    listens.start()
    header = kinds.Header(kinds.Time(3, 500_000_000), "")
    there.joints.write(kinds.JointState(header, list(NAMES), [1.0, 2.0], [], [3.0, 4.0]))
    there.state.write(
        kinds.ControllerState(header, list(NAMES), kinds.Point([1.5, 2.5], [], [], [], kinds.Duration(0, 0)))
    )
    listens.join()
    assert rows[0] is not None
    assert rows[0].t == 3.5
    np.testing.assert_array_equal(rows[0].q, [1.0, 2.0])
    time.sleep(0.2)
    reference = topics.reference()
    assert reference is not None
    np.testing.assert_array_equal(reference.q, [1.5, 2.5])


@pytest.mark.skipif(not DDS, reason="pip install cyclonedds")
def test_the_bytes_are_those_of_ros() -> None:
    from rosbags.typesys import Stores, get_typestore

    from etude_drivers import message_of, types

    own, kinds = motion(), types()
    data = message_of(Points(12.25, own.joints, own.t, own.q, own.qd, own.qdd), kinds).serialize()
    store, name = get_typestore(Stores.ROS2_JAZZY), "trajectory_msgs/msg/JointTrajectory"
    read: Any = store.deserialize_cdr(data, name)
    assert bytes(store.serialize_cdr(read, name)) == data
    np.testing.assert_array_equal([point.accelerations for point in read.points], own.qdd)


def other_side(topics: DdsTopics) -> SimpleNamespace:
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.pub import DataWriter
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic

    own, kinds = DomainParticipant(topics.domain), topics.types
    return SimpleNamespace(
        participant=own,
        goal=DataReader(own, Topic(own, "rt/arm_controller/joint_trajectory", kinds.JointTrajectory)),
        joints=DataWriter(own, Topic(own, "rt/joint_states", kinds.JointState)),
        state=DataWriter(own, Topic(own, "rt/arm_controller/controller_state", kinds.ControllerState)),
    )
