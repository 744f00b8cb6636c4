"""The driver `ur`: arms of Universal Robots by servoJ of ur_rtde.

servoJ smooths what it is asked for (lookahead, gain), so the arm lags by design; bounds of errors have to
hold that. A watchdog on the controller stops the arm when this program dies.
"""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Any, Self

import numpy as np

from etude.drivers import About, Control, Sample, require_known
from etude.errors import UsageError
from etude.logs.readers.extras import needed
from etude.types import Array

NAMES = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
"""Of joints in the descriptions of Universal Robots, before "_joint", in the controller's order."""
KEYS = ("rate", "lookahead", "gain", "deceleration")
"""Of the table [driver]."""
WATCHED = 10.0
"""Hz at which the controller wants to hear of us."""


def driver(joints: tuple[str, ...], address: str, settings: Mapping[str, Any]) -> UrArm:
    """`--on ur:ADDRESS`; [driver] has `KEYS`."""
    if not address:
        raise UsageError("ur needs the robot's address", next_step="--on ur:192.168.56.101")
    control, receive = needed("rtde_control", "the driver ur"), importlib.import_module("rtde_receive")
    return UrArm(joints, address, settings, control.RTDEControlInterface, receive.RTDEReceiveInterface)


class UrArm:
    """A Stream over ur_rtde.

    Args:
        joints: of the campaign. address: of the robot.
        settings: rate, 500 Hz of an e-Series and 125 of a CB3; lookahead, s; gain; deceleration, rad/s^2.
        control, receive: makers of ur_rtde's two interfaces. virtual: of a simulation, which waits for us.
    """

    def __init__(
        self,
        joints: Sequence[str],
        address: str,
        settings: Mapping[str, Any],
        control: Any,
        receive: Any,
        virtual: bool = False,
    ) -> None:
        require_known(settings, KEYS, "ur")
        self.joints, self.address, self.virtual = _ordered_joints(joints), address, virtual
        self.rate = float(settings.get("rate", 500.0))
        self.lookahead = float(settings.get("lookahead", 0.05))
        self.gain = float(settings.get("gain", 600.0))
        self.deceleration = float(settings.get("deceleration", 4.0))
        self._makers = control, receive
        self.control: Any = None
        self.receive: Any = None
        self._serves = False

    def about(self) -> About:
        return About(
            name="Universal Robots arm",
            identity=f"ur at {self.address}",
            joints=self.joints,
            rate=self.rate,
            command_unit="A",
            command_of="measured",
            gravity_in_command=True,
            can_hold=True,
            on_loss="stops",
            silence=0.1,
            real=not self.virtual,
            virtual=self.virtual,
            payload=self._payload(),
        )

    def _payload(self) -> float | None:
        """kg that the controller is set to; None without a connection, or where it reports none."""
        with contextlib.suppress(RuntimeError):
            return None if self.receive is None else float(self.receive.getPayload())
        return None

    def __enter__(self) -> Self:
        control, receive = self._makers
        self.receive = receive(self.address)
        self.control = control(self.address)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self.stop()
        for part in (self.control, self.receive):
            with contextlib.suppress(Exception):
                part.disconnect()
        self.control = self.receive = None

    def state(self) -> Sample:
        receive = self.receive
        fault = "emergency stop" if receive.isEmergencyStopped() else ""
        fault = fault or ("protective stop" if receive.isProtectiveStopped() else "")
        # while servoJ runs the target lags behind what was sent; at rest it is what holds the arm
        reference = None if self._serves else np.array(receive.getTargetQ())
        current, qd = np.array(receive.getActualCurrent()), np.array(receive.getActualQd())
        return Sample(
            receive.getTimestamp(), np.array(receive.getActualQ()), current, qd, reference, fault=fault
        )

    def ready(self, control: Control) -> None:
        if not self.control.isProgramRunning() and not self.control.reuploadScript():
            raise ConnectionError(
                "the control script does not run: check that the robot is in remote control"
            )
        self.control.setWatchdog(WATCHED)
        self._serves = True

    def send(self, q: Array, qd: Array, qdd: Array, effort: Array | None) -> None:
        self.control.kickWatchdog()
        if not self.control.servoJ(q.tolist(), 0.0, 0.0, 1.0 / self.rate, self.lookahead, self.gain):
            raise ConnectionError("the robot no longer accepts set-points")

    def stop(self, kill: bool = False) -> None:
        with contextlib.suppress(Exception):
            if kill:
                self.control.triggerProtectiveStop()
            elif self._serves:
                self.control.servoStop(self.deceleration)
        self._serves = False


def _ordered_joints(joints: Sequence[str]) -> tuple[str, ...]:
    """The controller has no names: prefixes are allowed, the rest is that of the descriptions."""
    matches = [[name for name in joints if name.endswith(f"{suffix}_joint")] for suffix in NAMES]
    if [len(names) for names in matches] != [1] * 6 or len(joints) != 6:
        raise UsageError(
            f"{', '.join(joints)} are not the six joints of an arm of Universal Robots",
            next_step=f"Name them {'_joint, '.join(NAMES)}_joint, with a prefix or without.",
        )
    return tuple(names[0] for names in matches)
