"""The driver `ur` over a mock of ur_rtde, whose names are compared with the wheel where that is there."""

from __future__ import annotations

import importlib

import numpy as np
import pytest

from etude.drivers import find_driver
from etude.errors import UsageError
from etude.testing import DriverSuite
from etude_drivers import UrArm

JOINTS = tuple(
    f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
)


class Robot:
    """Both interfaces: joints that follow the target with a lag, a cycle in each servoJ."""

    def __init__(self) -> None:
        self.q = np.array([0.3, -1.2, 1.4, -0.5, 0.8, 0.2])
        self.target, self.cycles, self.running = self.q.copy(), 0, False
        self.protective, self.calls, self.payload = False, [], 0.3

    def __call__(self, address: str) -> Robot:
        return self

    def getTimestamp(self) -> float:
        return 100.0 + self.cycles / 125.0

    def getActualQ(self) -> list[float]:
        return list(self.q)

    def getActualQd(self) -> list[float]:
        return list(self.target - self.q)

    def getTargetQ(self) -> list[float]:
        return list(self.target)

    def getActualCurrent(self) -> list[float]:
        return list(10.0 * (self.target - self.q))

    def getPayload(self) -> float:
        return self.payload

    def isProtectiveStopped(self) -> bool:
        return self.protective

    def isEmergencyStopped(self) -> bool:
        return False

    def isProgramRunning(self) -> bool:
        return self.running

    def reuploadScript(self) -> bool:
        self.running = True
        return True

    def setWatchdog(self, frequency: float) -> bool:
        self.calls.append("watchdog")
        return True

    def kickWatchdog(self) -> bool:
        self.calls.append("kick")
        return True

    def servoJ(
        self, q: list[float], speed: float, acceleration: float, t: float, ahead: float, gain: float
    ) -> bool:
        assert 0.03 <= ahead <= 0.2
        assert 100 <= gain <= 2000
        assert t == 1 / 125
        self.target = np.array(q)
        self.q += 0.6 * (self.target - self.q)
        self.cycles += 1
        self.calls.append("servoJ")
        return not self.protective

    def servoStop(self, deceleration: float) -> bool:
        self.calls.append("servoStop")
        return True

    def triggerProtectiveStop(self) -> bool:
        self.protective = True
        return True

    def disconnect(self) -> None:
        self.running = False


def arm(robot: Robot, joints: tuple[str, ...] = JOINTS) -> UrArm:
    return UrArm(joints, "robot", {"rate": 125.0}, robot, robot, virtual=True)


class TestUrArm(DriverSuite):
    joints = JOINTS

    def driver(self) -> UrArm:
        return arm(Robot())


def test_the_watchdog_is_set_before_and_kicked_with_every_set_point() -> None:
    robot = Robot()
    with arm(robot) as own:
        own.ready("feedback")
        for _ in range(3):
            own.send(robot.q, np.zeros(6), np.zeros(6), None)
        own.stop()
        own.stop()
    assert robot.calls == ["watchdog", *["kick", "servoJ"] * 3, "servoStop"]


def test_a_protective_stop_is_a_fault_and_ends_set_points() -> None:
    robot = Robot()
    with arm(robot) as own:
        own.ready("feedback")
        own.stop(kill=True)
        assert own.state().fault == "protective stop"
        with pytest.raises(ConnectionError, match="no longer accepts set-points"):
            own.send(robot.q, np.zeros(6), np.zeros(6), None)


def test_the_payload_that_it_is_set_to_is_told_once_it_is_connected() -> None:
    robot = Robot()
    with arm(robot) as own:
        assert own.about().answers_as == "ur at robot, set to carry 0.3 kg"
        robot.payload = 1.2
        assert own.about().payload == 1.2
    assert own.about().payload is None


def test_joints_go_by_name_with_any_prefix() -> None:
    named = tuple(f"left_{name}" for name in JOINTS)
    assert arm(Robot(), named[::-1]).about().joints == named
    with pytest.raises(UsageError, match="are not the six joints"):
        arm(Robot(), JOINTS[:5])


def test_the_wheel_has_these_names() -> None:
    """Of both interfaces; without a controller no more of it can be tried."""
    try:
        control, receive = (importlib.import_module(name) for name in ("rtde_control", "rtde_receive"))
    except ImportError:
        with pytest.raises(UsageError, match="needs ur_rtde"):
            find_driver("ur:192.168.56.101", JOINTS)
        return
    mine = {name for name in vars(Robot) if not name.startswith("_")}
    theirs = {*dir(control.RTDEControlInterface), *dir(receive.RTDEReceiveInterface)}
    assert mine <= theirs
