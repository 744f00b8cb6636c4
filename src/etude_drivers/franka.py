"""The driver `franka`: a Franka Research 3 over libfranka's torque interface at 1 kHz.

The feedback is ours, the robot adds gravity and friction itself. When this program dies or misses 20 cycles
in a row, the robot stops by itself. A real one needs a kernel with PREEMPT_RT.
"""

from __future__ import annotations

import contextlib
import re
import threading
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Any, Self

import numpy as np

from etude.drivers import About, Control, Sample, VelocityEnvelope, require_known
from etude.errors import UsageError
from etude.logs.readers.extras import needed
from etude.types import Array

GAINS = (600.0, 600.0, 600.0, 600.0, 250.0, 150.0, 50.0), (50.0, 50.0, 50.0, 50.0, 30.0, 25.0, 15.0)
"""Stiffness and damping, N m/rad and N m s/rad, as in libfranka's example of joint impedance."""
TORQUE = np.array([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0])  # N m
TORQUE_STEP = 0.9
"""N m from one cycle to the next; the robot aborts beyond 1."""
LOWER = np.array([-2.7437, -1.7837, -2.9007, -3.0421, -2.8065, 0.5445, -3.0159])  # rad
UPPER = np.array([2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159])
ENVELOPE = VelocityEnvelope(
    most=np.array([2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26]),
    offset=-np.array([0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35]),
    slope=np.array([12.0, 5.17, 7.0, 8.0, 34.0, 11.0, 34.0]),
    lower=np.array([-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196]),
    upper=np.array([2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196]),
)
"""Of the Franka Research 3, from Franka's page of control parameters."""
KEYS = ("realtime", "stiffness", "damping", "silence")
"""Of the table [driver]."""


def driver(joints: tuple[str, ...], address: str, settings: Mapping[str, Any]) -> FrankaArm:
    """`--on franka:ADDRESS`; [driver] has `KEYS`."""
    if not address:
        raise UsageError("franka needs the robot's address", next_step="--on franka:172.16.0.2")
    return FrankaArm(joints, address, settings, needed("pylibfranka", "the driver franka"))


class FrankaArm:
    """A Stream over `pylibfranka.Robot`; readOnce waits for the robot's next cycle."""

    def __init__(
        self, joints: Sequence[str], address: str, settings: Mapping[str, Any], library: Any
    ) -> None:
        require_known(settings, KEYS, "franka")
        self.joints, self.address, self.library = _ordered_joints(joints), address, library
        self.stiffness = np.array(settings.get("stiffness", GAINS[0]), dtype=float)
        self.damping = np.array(settings.get("damping", GAINS[1]), dtype=float)
        self.realtime = bool(settings.get("realtime", True))
        self.silence = float(settings.get("silence", 0.1))
        self.robot: Any = None
        self._control: Any = None
        self._thread = 0
        self._state: Any = None
        self._torque = np.zeros(7)

    def about(self) -> About:
        return About(
            name="Franka Research 3",
            identity=f"franka at {self.address}",
            joints=self.joints,
            rate=1000.0,
            command_unit="N m",
            command_of="desired",
            gravity_in_command=False,
            controls=("feedback", "learned"),
            lower=LOWER,
            upper=UPPER,
            velocity=ENVELOPE.most,
            acceleration=np.full(7, 10.0),
            jerk=np.full(7, 5000.0),
            torque_rate=np.full(7, 1000.0),
            envelope=ENVELOPE,
            can_hold=True,
            on_loss="stops",
            silence=self.silence,
            payload=None if self.robot is None else float(self._state.m_load),
        )

    def __enter__(self) -> Self:
        config = self.library.RealtimeConfig
        self.robot = self.library.Robot(self.address, config.kEnforce if self.realtime else config.kIgnore)
        self._state = self.robot.read_once()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self.stop()
        self.robot = None

    def state(self) -> Sample:
        if self._control is None:
            self._state = self.robot.read_once()
        else:
            self._state, _ = self._control.readOnce()
        reading = self._state
        errors = str(reading.current_errors).strip("[]")
        # outside of a motion the robot holds where it is, and a motion starts there
        reference = None if self._control is not None else np.array(reading.q)
        return Sample(
            reading.time.to_sec(),
            np.array(reading.q),
            np.array(reading.tau_J_d),
            np.array(reading.dq),
            reference,
            fault=errors,
        )

    def ready(self, control: Control) -> None:
        self._control, self._thread = self.robot.start_torque_control(), threading.get_ident()
        self._torque = np.zeros(7)

    def send(self, q: Array, qd: Array, qdd: Array, effort: Array | None) -> None:
        reading = self._state
        torque = self.stiffness * (q - np.array(reading.q)) + self.damping * (qd - np.array(reading.dq))
        if effort is not None:
            torque = torque + effort
        torque = np.clip(
            np.clip(torque, -TORQUE, TORQUE), self._torque - TORQUE_STEP, self._torque + TORQUE_STEP
        )
        self._torque = torque
        self._control.writeOnce(self.library.Torques(torque.tolist()))

    def stop(self, kill: bool = False) -> None:
        """In the loop's own thread the motion is finished; from another one the robot stops it, and the loop
        gets an exception.
        """
        with contextlib.suppress(Exception):
            control = self._control
            if control is not None and self._thread == threading.get_ident() and not kill:
                self._control = None
                last = self.library.Torques(self._torque.tolist())
                last.motion_finished = True
                control.readOnce()
                control.writeOnce(last)
            elif self.robot is not None and control is not None:
                self._control = None
                self.robot.stop()


def _ordered_joints(joints: Sequence[str]) -> tuple[str, ...]:
    """libfranka has no names: joint 4 is the one whose name ends with 4."""
    numbers = {int(match[1]): name for name in joints if (match := re.search(r"(\d)$", name))}
    if sorted(numbers) != list(range(1, 8)) or len(joints) != 7:
        raise UsageError(
            f"{', '.join(joints)} are not the joints 1 to 7 of a Franka arm",
            next_step="Name them fr3_joint1 to fr3_joint7, as Franka's description does.",
        )
    return tuple(numbers[number] for number in range(1, 8))
