"""The driver `lerobot`: arms of LeRobot (SO-100, SO-101, Koch, OpenArm), by their own methods alone.

No servo bus reports the time, so samples have the computer's clock. A robot follows the last goal that it
got, also when this program dies, so to stop is to send no other one.
"""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from types import TracebackType
from typing import Any, Self

import numpy as np

from etude.drivers import About, Control, Sample, require_known
from etude.errors import UsageError
from etude.types import Array

KEYS = ("rate", "id", "current_step")
"""Of the table [driver]."""
CLIPPED = 1e-6
"""Degrees by which the goal that was sent may differ from the one that was asked for."""
STEP = 2 * math.pi / 4096
"""rad, of the magnetic encoders of these servos."""


def driver(joints: tuple[str, ...], address: str, settings: Mapping[str, Any]) -> LeRobotArm:
    """`--on lerobot:TYPE:PORT`, as lerobot:so101_follower:/dev/ttyACM0; [driver] has `KEYS`."""
    kind, _, port = address.partition(":")
    if not (kind and port):
        raise UsageError(
            "lerobot needs a type and a port", next_step="--on lerobot:so101_follower:/dev/ttyACM0"
        )
    try:
        config = importlib.import_module("lerobot.robots.config").RobotConfig
        make = importlib.import_module("lerobot.robots.utils").make_robot_from_config
        importlib.import_module(f"lerobot.robots.{kind.replace('so100', 'so').replace('so101', 'so')}")
    except ImportError as problem:
        raise UsageError(
            f"the driver lerobot needs lerobot and the requirements of {kind} ({problem})",
            next_step="Install it: pip install 'lerobot[feetech]>=0.4', or [dynamixel], [damiao]",
        ) from problem
    robot = make(config.get_choice_class(kind)(port=port, id=settings.get("id")))
    return LeRobotArm(joints, robot, settings)


class LeRobotArm:
    """A Stream over an object with the methods of `lerobot.robots.Robot`.

    Args:
        joints: names of its motors. robot: not connected.
        settings: rate, Hz; current_step: A of one step of Present_Current, where it reports no torque.
        clock: of a simulation; None: the computer's.
    """

    def __init__(
        self,
        joints: Sequence[str],
        robot: Any,
        settings: Mapping[str, Any],
        clock: Callable[[], float] | None = None,
    ) -> None:
        self.joints, self.robot, self.virtual = tuple(joints), robot, clock is not None
        self.clock = clock or time.monotonic
        require_known(settings, KEYS, "lerobot")
        self.rate = float(settings.get("rate", 50.0))
        features = robot.observation_features
        lacking = [name for name in joints if f"{name}.pos" not in features]
        if lacking:
            has = ", ".join(name.removesuffix(".pos") for name in features if name.endswith(".pos"))
            raise UsageError(f"{robot.name} has no motor {', '.join(lacking)}", next_step=f"It has {has}.")
        self.torque = all(f"{name}.torque" in features for name in joints)
        self.step = settings.get("current_step")
        if not self.torque and self.step is None:
            raise UsageError(
                f"{robot.name} reports currents in steps, but current_step is not stated",
                where="run.toml [driver]",
                next_step="Write A per step from the servo's manual: current_step = 0.0065 for an STS3215.",
            )
        self._require_degrees()

    def _require_degrees(self) -> None:
        motors = getattr(getattr(self.robot, "bus", None), "motors", {})
        modes = {name: getattr(motors.get(name), "norm_mode", None) for name in self.joints}
        other = [n for n, mode in modes.items() if mode is not None and "degrees" not in str(mode).lower()]
        if other:
            raise UsageError(
                f"positions of {', '.join(other)} are fractions of a range, not angles",
                where=self.robot.name,
                next_step="Create the robot with use_degrees=True and calibrate it.",
            )

    def about(self) -> About:
        return About(
            name=self.robot.name,
            identity=f"{self.robot.name} {getattr(self.robot, 'id', None) or 'without id'}",
            joints=self.joints,
            rate=self.rate,
            command_unit="N m" if self.torque else "A",
            command_of="measured",
            gravity_in_command=True,
            can_hold=True,
            on_loss="holds",
            silence=max(0.1, 5 / self.rate),
            encoder_step=np.full(len(self.joints), STEP),
            real=not self.virtual,
            virtual=self.virtual,
        )

    def __enter__(self) -> Self:
        self.robot.connect(calibrate=False)  # it would ask on the terminal
        if not self.robot.is_calibrated:
            self.robot.disconnect()
            raise UsageError(
                f"{self.robot.name} is not calibrated",
                next_step="Run lerobot-calibrate for it, with the same id, then run this again.",
            )
        if hasattr(self.robot.config, "disable_torque_on_disconnect"):
            self.robot.config.disable_torque_on_disconnect = False  # the arm would drop
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self.robot.disconnect()

    def state(self) -> Sample:
        observation = self.robot.get_observation()
        if self.torque:
            command = np.array([observation[f"{name}.torque"] for name in self.joints])
        else:
            steps = self.robot.bus.sync_read("Present_Current", list(self.joints), normalize=False)
            command = float(self.step or 0.0) * _signed(np.array([steps[name] for name in self.joints]))
        return Sample(self.clock(), np.radians([observation[f"{name}.pos"] for name in self.joints]), command)

    def ready(self, control: Control) -> None:
        self.robot.bus.enable_torque(list(self.joints))

    def send(self, q: Array, qd: Array, qdd: Array, effort: Array | None) -> None:
        goal = {f"{name}.pos": float(value) for name, value in zip(self.joints, np.degrees(q), strict=True)}
        sent = self.robot.send_action(goal)
        for key, value in goal.items():
            if abs(sent[key] - value) > CLIPPED:
                name = key.removesuffix(".pos")
                raise UsageError(
                    f"{self.robot.name} clipped {name} from {value:.3f} to {sent[key]:.3f} degrees",
                    next_step="Create it with max_relative_target=None, because Étude itself limits its "
                    "motions.",
                )

    def stop(self, kill: bool = False) -> None:
        """The servos hold the last goal; cutting their torque would drop the arm."""


def _signed(steps: Array) -> Array:
    """Currents of Feetech's servos have their sign in the highest of 16 bits; LeRobot leaves it there."""
    return np.where(steps >= 0x8000, 0x8000 - steps, steps).astype(float)
