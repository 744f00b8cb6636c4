"""The driver `px4`: multirotors with PX4, by MAVLink's offboard set-points. Experimental.

PX4 takes position, velocity and acceleration of each set-point to its own controllers. It has to hear
set-points for a second before it enters offboard mode, and leaves that mode when they end. Frames are turned
here: set-points and places are north, east, down there, and east, north, up in a campaign; bodies are
forward, right, down there, and forward, left, up here.

A motion begins in offboard mode, armed, and ends in PX4's own hold mode. Nothing switches rotors off in the
air: a kill is a hold, too.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from types import TracebackType
from typing import Any, Self

import numpy as np

from etude.drivers import About, Control, Sample, require_known
from etude.errors import UsageError
from etude.logs.readers.extras import needed
from etude.types import Array
from etude_drivers.vehicles import AXES, require_axes, require_charge, require_heading, yaw_of
from etude_quadrotor.export.offboard import NED, YAW
from etude_quadrotor.logs.ulog import turned

KEYS = ("rate", "motors", "pulse", "on_loss", "battery")
"""Of the table [driver]."""
FLU = np.array([1.0, -1.0, -1.0])
"""(forward, left, up) <- (forward, right, down), and back."""
PX4 = 12  # MAV_AUTOPILOT
MULTIROTORS = {2: 4, 13: 6, 14: 8, 15: 3, 29: 12}
"""MAV_TYPE, and how many rotors."""
ARMED = 128  # in base_mode
CUSTOM = 1  # the mode is PX4's own
OFFBOARD, HOLD, LAND = (6, 0), (4, 3), (4, 6)
"""Main mode and sub-mode of PX4."""
MODES = {1: "manual", 2: "altitude", 3: "position", 4: "auto", 5: "acro", 6: "offboard", 7: "stabilized"}
SET_MODE, ARM, INTERVAL, REQUEST = 176, 400, 511, 512
"""MAV_CMD_: DO_SET_MODE, COMPONENT_ARM_DISARM, SET_MESSAGE_INTERVAL, REQUEST_MESSAGE."""
HEARTBEAT = 0
"""PX4 gives it no other rate than once a second, but sends it when it is asked to."""
MODE_S = 0.1
"""Between two requests of the mode; for an answer before the mode is changed."""
PLACE, WANTED = 32, (31, 32, 105, 375)
"""LOCAL_POSITION_NED; with ATTITUDE_QUATERNION, HIGHRES_IMU and ACTUATOR_OUTPUT_STATUS."""
LOCAL, NO_YAW_RATE = 1, 2048
"""MAV_FRAME_LOCAL_NED, and the mask of a set-point whose yaw rate alone is not stated."""
BEFORE_S = 1.2
"""Of set-points before offboard mode."""
ANSWER_S = 3.0
"""For an answer of the autopilot."""


def driver(joints: tuple[str, ...], address: str, settings: Mapping[str, Any]) -> Px4Vehicle:
    """`--on px4:udpin:0.0.0.0:14540`, an address of pymavlink; [driver] has `KEYS`."""
    if not address:
        raise UsageError("px4 needs an address", next_step="--on px4:udpin:0.0.0.0:14540")
    mavutil = needed("pymavlink.mavutil", "the driver px4")
    return Px4Vehicle(
        joints, address, settings, lambda url: mavutil.mavlink_connection(url, dialect="common")
    )


class Px4Vehicle:
    """A Stream over MAVLink.

    Args:
        joints: of the campaign: x, y and z. address: of the vehicle.
        settings: rate, Hz; motors, names of the campaign's commands in the order of PX4's outputs; pulse, us
            at command 0 and 1; on_loss, what PX4 does when set-points end, by its COM_OBL_RC_ACT; battery,
            least part of the charge with which a motion begins.
        connect: makes a connection of pymavlink. virtual: of a simulation, whose time advances with
            set-points.
    """

    def __init__(
        self,
        joints: Sequence[str],
        address: str,
        settings: Mapping[str, Any],
        connect: Callable[[str], Any],
        virtual: bool = False,
    ) -> None:
        require_known(settings, KEYS, "px4")
        require_axes(joints, "px4")
        self.address, self.virtual = address, virtual
        self.rate = float(settings.get("rate", 50.0))
        self.motors = tuple(settings.get("motors", ("m1", "m2", "m3", "m4")))
        self.pulse = tuple(map(float, settings.get("pulse", (1000.0, 2000.0))))
        self.on_loss = settings.get("on_loss", "unknown")
        self.battery = float(settings.get("battery", 0.3))
        self._connect, self._lock = connect, threading.Lock()
        self._link: Any = None
        self._newest: dict[str, Any] = {}
        self._serves = self._armed_by_us = False
        self._held: Array | None = None  # (3,) set-point at rest that was sent last
        self._sent, self._reader = 0, threading.current_thread()

    def about(self) -> About:
        return About(
            name="PX4 multirotor",
            identity=f"px4 at {self.address}",
            joints=AXES,
            rate=self.rate,
            command_unit="1",
            command_of="applied",
            gravity_in_command=True,
            controls=("feedback", "learned"),
            learned_as="px4",
            can_hold=True,
            stopping_time=2.0,
            on_loss=self.on_loss,
            silence=0.3,
            real=not self.virtual,
            virtual=self.virtual,
        )

    def __enter__(self) -> Self:
        self._link = self._connect(self.address)
        beat = self._wait_for("HEARTBEAT", lambda m: m.type != 6)  # no other ground station
        if beat.autopilot != PX4 or MULTIROTORS.get(beat.type) != len(self.motors):
            self._link.close()
            raise UsageError(
                f"at {self.address} is MAV_TYPE {beat.type} of autopilot {beat.autopilot}, and not a "
                f"multirotor of PX4 with {len(self.motors)} rotors",
                next_step="Check the address, and motors in [driver].",
            )
        for message in WANTED:
            self._command(INTERVAL, message, 1e6 / self.rate)
        self._wait_for("LOCAL_POSITION_NED")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        """Lands what this driver has armed; else PX4 holds, as it was found."""
        self.stop()
        with contextlib.suppress(Exception):
            if self._armed_by_us:
                self._ask_mode()
                if self._is_controllable():
                    self._mode(LAND)
        self._link.close()
        self._armed_by_us = False

    def state(self) -> Sample:
        """The newest place with what else was heard until then; it waits for the next one."""
        self._reader = threading.current_thread()
        before = self._newest["LOCAL_POSITION_NED"].time_boot_ms
        self._read(0.0)
        if not self.virtual and self._newest["LOCAL_POSITION_NED"].time_boot_ms == before:
            self._read(1.0 / self.rate, until="LOCAL_POSITION_NED")
        place = self._newest["LOCAL_POSITION_NED"]
        q, qd = (
            NED @ np.array(vector) for vector in ((place.x, place.y, place.z), (place.vx, place.vy, place.vz))
        )
        reference = None if self._serves else self._held
        return Sample(
            place.time_boot_ms / 1e3, q, None, qd, reference, fault=self._fault(), extra=self._log_columns()
        )

    def ready(self, control: Control) -> None:
        """Set-points where it stands, offboard mode, armed. ConnectionError: PX4 refuses, and why."""
        self.state()
        require_charge(self._charge(), self.battery)
        require_heading(self._heading_error(), "the x axis, which is east")
        here = self.state().q if self._held is None else self._held
        for _ in range(round(BEFORE_S * self.rate)):
            self._send(here, np.zeros(3), np.zeros(3))
            self._pause()
        self._confirm(self._mode(OFFBOARD), "offboard mode", here)
        if not self._beat.base_mode & ARMED:
            self._confirm(self._command(ARM, 1.0), "to arm", here)
            self._armed_by_us = True
        self._until(lambda: self._is(OFFBOARD) and bool(self._beat.base_mode & ARMED), "offboard mode", here)
        self._serves = True

    def send(self, q: Array, qd: Array, qdd: Array, effort: Array | None) -> None:
        rests = not qd.any()
        self._send(q, qd, qdd if effort is None or rests else qdd + effort)  # what rests has no drag
        self._held = q.copy() if rests else None
        self._sent += 1
        if self._sent % max(round(MODE_S * self.rate), 1) == 0:
            self._command(REQUEST, HEARTBEAT)

    def stop(self, kill: bool = False) -> None:
        """PX4's hold mode, unless a person or PX4 itself has taken over."""
        with contextlib.suppress(Exception):
            if self._serves and threading.current_thread() is self._reader:
                self._ask_mode()
            if self._serves and self._is_controllable():
                self._mode(HOLD)
        self._serves = False

    def _ask_mode(self) -> None:
        """The mode of now; that of the last request, where no answer comes."""
        self._read(0.0)  # what has come before is no answer
        before, end = self._beat, time.monotonic() + MODE_S
        self._command(REQUEST, HEARTBEAT)
        while self._beat is before and time.monotonic() < end:
            self._read(0.0 if self.virtual else MODE_S, until="HEARTBEAT")

    @property
    def _beat(self) -> Any:
        return self._newest["HEARTBEAT"]

    def _is(self, mode: tuple[int, int]) -> bool:
        custom_mode = self._beat.custom_mode
        return bool(
            (custom_mode >> 16 & 255) == mode[0]
            and (mode == OFFBOARD or (custom_mode >> 24 & 255) == mode[1])
        )

    def _is_controllable(self) -> bool:
        return self._is(OFFBOARD) or self._is(HOLD)

    def _fault(self) -> str:
        """Why it does not follow any more, once it should."""
        if not self._serves:
            return ""
        if not self._beat.base_mode & ARMED:
            return f"PX4 has disarmed{self._status_text()}"
        if not self._is(OFFBOARD):
            mode = MODES.get(self._beat.custom_mode >> 16 & 255, "another")
            why = f"a pilot or a failsafe has taken over{self._status_text()}"
            return f"PX4 has left offboard mode for {mode} mode: {why}"
        return ""

    def _status_text(self) -> str:
        message = self._newest.get("STATUSTEXT")
        return "" if message is None else f" ({message.text})"

    def _charge(self) -> float:
        """Part of the charge that is left; 1 where PX4 does not know."""
        status = self._newest.get("SYS_STATUS")
        return 1.0 if status is None or status.battery_remaining < 0 else status.battery_remaining / 100.0

    def _heading_error(self) -> float:
        attitude = self._newest.get("ATTITUDE_QUATERNION")
        if attitude is None:
            return 0.0
        return math.remainder(yaw_of(attitude.q1, attitude.q2, attitude.q3, attitude.q4) - YAW, 2 * math.pi)

    def _log_columns(self) -> dict[str, float]:
        """Measurements to learn from, by log column."""
        columns: dict[str, float] = {}
        if (message := self._newest.get("HIGHRES_IMU")) is not None:
            force, rates = (
                np.array([message.xacc, message.yacc, message.zacc]),
                np.array([message.xgyro, message.ygyro, message.zgyro]),
            )
            for word, vector in (("specific_force", FLU * force), ("rates", FLU * rates)):
                columns |= {f"{word}_{axis}": float(x) for axis, x in zip(AXES, vector, strict=True)}
        if (message := self._newest.get("ATTITUDE_QUATERNION")) is not None:
            q = turned(np.array([[message.q1, message.q2, message.q3, message.q4]]))[0]
            columns |= {f"orientation_{part}": float(x) for part, x in zip("wxyz", q, strict=True)}
        if (message := self._newest.get("ACTUATOR_OUTPUT_STATUS")) is not None:
            low, high = self.pulse
            parts = [(x - low) / (high - low) for x in message.actuator[: len(self.motors)]]
            columns |= {f"command_{name}": float(x) for name, x in zip(self.motors, parts, strict=True)}
        if (message := self._newest.get("SYS_STATUS")) is not None and message.voltage_battery < 65535:
            columns["battery_voltage_pack"] = message.voltage_battery / 1e3
        return columns

    def _send(self, q: Array, qd: Array, qdd: Array) -> None:
        place, speed, force = ((NED @ vector).tolist() for vector in (q, qd, qdd))
        with self._lock:
            self._link.mav.set_position_target_local_ned_send(
                0, *self._target, LOCAL, NO_YAW_RATE, *place, *speed, *force, YAW, 0.0
            )

    @property
    def _target(self) -> tuple[int, int]:
        return self._beat.get_srcSystem(), self._beat.get_srcComponent()

    def _command(self, what: int, *values: float) -> int:
        filled = (*values, *(0.0,) * (7 - len(values)))
        self._newest.pop("COMMAND_ACK", None)
        with self._lock:
            self._link.mav.command_long_send(*self._target, what, 0, *filled)
        return what

    def _mode(self, mode: tuple[int, int]) -> int:
        return self._command(SET_MODE, CUSTOM, *mode)

    def _confirm(self, what: int, request: str, here: Array) -> None:
        """Waits for the answer to a command. ConnectionError: it is a refusal."""

        def acknowledged() -> bool:
            message = self._newest.get("COMMAND_ACK")
            return message is not None and message.command == what

        self._until(acknowledged, request, here)
        if self._newest["COMMAND_ACK"].result:
            raise ConnectionError(f"PX4 refuses {request}{self._status_text()}")

    def _until(self, true: Callable[[], bool], request: str, here: Array) -> None:
        """While set-points go on."""
        for _ in range(round(ANSWER_S * self.rate)):
            if true():
                return
            self._send(here, np.zeros(3), np.zeros(3))
            self._pause()
        raise ConnectionError(f"PX4 did not answer to {request} within {ANSWER_S:g} s")

    def _pause(self) -> None:
        self._read(0.0 if self.virtual else 1.0 / self.rate)

    def _wait_for(self, name: str, accepts: Callable[[Any], bool] = lambda _: True) -> Any:
        """The first message of that name. ConnectionError: none came."""
        end = time.monotonic() + ANSWER_S
        while time.monotonic() < end:
            self._read(0.1, until=name)
            message = self._newest.get(name)
            if message is not None and accepts(message):
                return message
        raise ConnectionError(f"no {name} came from {self.address} within {ANSWER_S:g} s")

    def _read(self, seconds: float, until: str = "") -> None:
        """All that has come, and what comes within that time, or until a message of that name."""
        end = time.monotonic() + seconds
        while True:
            left = end - time.monotonic()
            message = self._link.recv_match(blocking=left > 0.0, timeout=max(left, 0.0))
            if message is None and left <= 0.0:
                return
            if message is None:
                continue
            if message.get_type() == "HEARTBEAT" and message.type == 6:
                continue
            self._newest[message.get_type()] = message
            if message.get_type() == until:
                end = 0.0
