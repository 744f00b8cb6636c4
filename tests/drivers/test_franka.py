"""The driver `franka`: over a mock of pylibfranka's names, and, where both are installed, over the real
libfranka and the server of franky-sim.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from etude.drivers import Bounds, Ended, Streamed, Supervisor, find_driver, planned
from etude.errors import UsageError
from etude.testing import DriverSuite
from etude.trajectories import PointToPoint
from etude_drivers import FrankaArm

JOINTS = tuple(f"fr3_joint{number}" for number in range(1, 8))
POSE = np.array([0.0, 0.1, 0.0, -1.5, 0.2, 1.6, 0.7])


class Torques:
    def __init__(self, values: list[float]) -> None:
        self.tau_J, self.motion_finished = values, False


class Robot:
    """Joints without weight, as the robot adds gravity itself."""

    def __init__(self, address: str, realtime: object) -> None:
        self.q, self.dq, self.torque, self.cycles = POSE.copy(), np.zeros(7), np.zeros(7), 0
        self.errors, self.written, self.stopped, self.load = "[]", [], 0, 0.3

    def read_once(self) -> Any:
        stamp = SimpleNamespace(to_sec=lambda: 0.001 * self.cycles)
        return SimpleNamespace(
            q=list(self.q),
            dq=list(self.dq),
            tau_J_d=list(self.torque),
            time=stamp,
            current_errors=self.errors,
            m_load=self.load,
        )

    def start_torque_control(self) -> Robot:
        return self

    def readOnce(self) -> tuple[Any, None]:
        return self.read_once(), None

    def writeOnce(self, torques: Torques) -> None:
        self.written.append(torques)
        self.torque = np.array(torques.tau_J)
        self.dq += 0.001 * self.torque
        self.q += 0.001 * self.dq
        self.cycles += 1

    def stop(self) -> None:
        self.stopped += 1


LIBRARY = SimpleNamespace(Robot=Robot, Torques=Torques, RealtimeConfig=SimpleNamespace(kEnforce=0, kIgnore=1))


def test_torques_are_bounded_in_size_and_rate_and_the_motion_is_finished() -> None:
    arm = FrankaArm(JOINTS, "robot", {}, LIBRARY)
    with arm:
        arm.state()
        arm.ready("feedback")
        for _ in range(300):
            q = arm.state().q
            arm.send(q + 1.0, np.zeros(7), np.zeros(7), np.full(7, 5.0))
        robot = arm.robot
        arm.stop()
        arm.stop()
    torques = np.array([one.tau_J for one in robot.written])
    assert np.abs(np.diff(torques, axis=0)).max() <= 0.9 + 1e-12
    assert np.all(torques.max(axis=0) <= [87, 87, 87, 87, 12, 12, 12])
    assert [one.motion_finished for one in robot.written] == [False] * 300 + [True]


def test_what_the_robot_reports_is_a_fault_and_kill_is_its_own_stop() -> None:
    arm = FrankaArm(JOINTS, "robot", {}, LIBRARY)
    with arm:
        arm.robot.errors = '["joint_velocity_violation"]'
        assert "joint_velocity_violation" in arm.state().fault
        arm.ready("feedback")
        arm.stop(kill=True)
        assert arm.robot.stopped == 1


def test_the_load_that_it_is_set_to_is_told_once_it_is_connected() -> None:
    arm = FrankaArm(JOINTS, "robot", {}, LIBRARY)
    assert arm.about().payload is None
    with arm:
        assert arm.about().answers_as == "franka at robot, set to carry 0.3 kg"
        arm.robot.load = 1.2
        arm.state()
        assert arm.about().payload == 1.2


def test_joints_go_by_their_numbers() -> None:
    assert FrankaArm(JOINTS[::-1], "robot", {}, LIBRARY).about().joints == JOINTS
    with pytest.raises(UsageError, match="are not the joints 1 to 7"):
        FrankaArm(("waist",), "robot", {}, LIBRARY)


@pytest.mark.skipif(importlib.util.find_spec("pylibfranka") is not None, reason="it is installed")
def test_the_library_that_lacks_is_named_itself() -> None:
    with pytest.raises(UsageError, match="needs pylibfranka") as caught:
        find_driver("franka:172.16.0.2", JOINTS)
    assert "pip install 'pylibfranka" in caught.value.next_step


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    """franky-sim on a loopback address."""
    pytest.importorskip("pylibfranka")
    pytest.importorskip("franky_sim")
    program = Path(sys.executable).with_name("franky-sim")
    process = subprocess.Popen([program, "-s", "mujoco", "--hostname", "127.0.0.1"])
    time.sleep(8.0)
    try:
        yield "127.0.0.1"
    finally:
        process.terminate()
        process.wait(20.0)


@pytest.mark.slow  # it needs the server, and plays in its time
class TestFrankySim(DriverSuite):
    joints = JOINTS
    clock = 1e3  # of a simulation that is slower than time

    @pytest.fixture(autouse=True)
    def _served(self, server: str) -> None:
        self.address = server

    def driver(self) -> FrankaArm:
        settings = {"realtime": False, "silence": 0.5}  # the server may stand still on a busy machine
        return FrankaArm(JOINTS, self.address, settings, importlib.import_module("pylibfranka"))

    def test_learned_effort_is_added(self) -> None:
        """A push of 3 N m on joint 1, which the feedback has to balance."""
        with Streamed(self.driver()) as player:
            about, start = player.about(), player.where().asked
            assert start is not None
            path = PointToPoint(np.array([start, start + 0.01, start]), 0.2, dwell=0.5, peak_acceleration=1.0)
            motion = planned(
                path.to_json().encode(),
                number=1,
                part="motion",
                speed=100,
                names=JOINTS,
                joints=JOINTS,
                rate=about.rate,
                effort=lambda own: np.tile([3.0, 0, 0, 0, 0, 0, 0], (len(own.t), 1)),
            )
            bounds = Bounds(np.full(7, 0.1), about.lower, about.upper, about.velocity, clock=1e3)  # type: ignore[arg-type]
            supervisor = Supervisor(bounds, about, motion)
            recording = player.play(motion, supervisor.watch, "learned")
        assert recording.ended is Ended.DONE, supervisor.reason
        assert recording.q[-1, 0] - recording.asked[-1, 0] == pytest.approx(3.0 / 600.0, abs=2e-3)
