"""The driver `lerobot` over a stand-in with the methods, names and units of LeRobot 0.4.4's SO-101."""

from __future__ import annotations

from enum import StrEnum
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from etude.drivers import Streamed
from etude.errors import UsageError
from etude.testing import DriverSuite
from etude_drivers import LeRobotArm

MOTORS = ("shoulder_pan", "shoulder_lift")
STEP = 360.0 / 4096


class Mode(StrEnum):
    DEGREES = "degrees"
    PARTS = "range_m100_100"


class Bus:
    """Servos that follow their goals with a lag, a cycle of 20 ms in each `sync_write`."""

    def __init__(self, mode: Mode) -> None:
        self.motors = {name: SimpleNamespace(norm_mode=mode) for name in (*MOTORS, "gripper")}
        self.q = {"shoulder_pan": 20.0, "shoulder_lift": -35.0, "gripper": 0.0}
        self.goal, self.cycles, self.on = dict(self.q), 0, False

    def sync_read(
        self, name: str, motors: list[str] | None = None, *, normalize: bool = True
    ) -> dict[str, Any]:
        names = motors or list(self.motors)
        if name == "Present_Position":
            assert normalize
            return {own: round(self.q[own] / STEP) * STEP for own in names}
        assert name == "Present_Current"
        assert not normalize, "currents are no positions"
        steps = {own: round(10 * (self.goal[own] - self.q[own])) for own in names}
        return {own: value if value >= 0 else 0x8000 - value for own, value in steps.items()}

    def sync_write(self, name: str, goals: dict[str, float]) -> None:
        assert name == "Goal_Position"
        assert self.on, "the torque is off"
        self.goal.update(goals)
        for own in self.q:
            self.q[own] += 0.7 * (self.goal[own] - self.q[own])
        self.cycles += 1

    def enable_torque(self, motors: list[str]) -> None:
        self.on = True


class SO101:
    """As `lerobot.robots.so_follower.SOFollower`."""

    name = "so101_follower"

    def __init__(
        self, mode: Mode = Mode.DEGREES, clips: float | None = None, calibrated: bool = True
    ) -> None:
        self.bus, self.id, self.is_calibrated = Bus(mode), "left", calibrated
        self.config = SimpleNamespace(max_relative_target=clips, disable_torque_on_disconnect=True)
        self.connected = False

    @property
    def observation_features(self) -> dict[str, type]:
        return {f"{name}.pos": float for name in self.bus.motors}

    def connect(self, calibrate: bool = True) -> None:
        assert not calibrate, "it would read from the terminal"
        self.connected = True

    def disconnect(self) -> None:
        self.connected = False

    def get_observation(self) -> dict[str, float]:
        return {f"{name}.pos": value for name, value in self.bus.sync_read("Present_Position").items()}

    def send_action(self, action: dict[str, float]) -> dict[str, float]:
        goals = {key.removesuffix(".pos"): value for key, value in action.items()}
        most = self.config.max_relative_target
        if most is not None:
            goals = {
                n: float(np.clip(v, self.bus.q[n] - most, self.bus.q[n] + most)) for n, v in goals.items()
            }
        self.bus.sync_write("Goal_Position", goals)
        return {f"{name}.pos": value for name, value in goals.items()}


def arm(robot: SO101, joints: tuple[str, ...] = MOTORS, **settings: Any) -> LeRobotArm:
    return LeRobotArm(joints, robot, {"current_step": 0.0065, **settings}, lambda: 0.02 * robot.bus.cycles)


class TestLeRobotArm(DriverSuite):
    joints = MOTORS
    error = 0.15

    def driver(self) -> LeRobotArm:
        return arm(SO101())


def test_currents_have_their_sign_and_unit() -> None:
    robot = SO101()
    robot.bus.goal = {"shoulder_pan": 22.0, "shoulder_lift": -36.0}
    with arm(robot) as own:
        np.testing.assert_allclose(own.state().command, [20 * 0.0065, -10 * 0.0065])
        np.testing.assert_allclose(own.state().q, np.radians([20.0, -35.0]), atol=np.radians(STEP))


def test_the_arm_does_not_drop_at_the_end() -> None:
    robot = SO101()
    with arm(robot):
        assert robot.connected
    assert not robot.connected
    assert robot.config.disable_torque_on_disconnect is False


@pytest.mark.parametrize(
    ("robot", "joints", "settings", "words"),
    [
        (SO101(Mode.PARTS), MOTORS, {}, "are fractions of a range, not angles"),
        (SO101(), ("knee",), {}, "has no motor knee"),
        (SO101(), MOTORS, {"current_step": None}, "current_step is not stated"),
        (SO101(), MOTORS, {"colour": 1}, "no key colour"),
    ],
)
def test_what_is_not_stated_blocks(
    robot: SO101, joints: tuple[str, ...], settings: dict[str, Any], words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        arm(robot, joints, **settings)


def test_an_arm_that_is_not_calibrated_asks_nothing_on_the_terminal() -> None:
    with pytest.raises(UsageError, match="is not calibrated"), Streamed(arm(SO101(calibrated=False))):
        pass


def test_a_goal_that_was_clipped_ends_the_motion() -> None:
    own = arm(SO101(clips=1.0))
    own.ready("feedback")
    with pytest.raises(UsageError, match=r"clipped shoulder_pan from .* to 21"):
        own.send(np.radians([40.0, -35.0]), np.zeros(2), np.zeros(2), None)
