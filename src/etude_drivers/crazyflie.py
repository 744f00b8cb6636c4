"""The driver `crazyflie`: Crazyflies by full-state set-points of cflib. Experimental.

A Crazyflie takes position, velocity and acceleration of each set-point, in whole millimetres of 16 bits, to
its own controller. It levels out half a second after the last set-point, and its rotors stop 2 s after it. So
a motion ends in the hands of its high-level commander, which hovers by itself. That commander gets its place
before it is let in: without one it stops the rotors.

World and body are as in a campaign: z up, and forward, left, up. Nothing switches rotors off in the air: a
kill is a hover, too. cflib sends a thrust of zero when a link closes, so links are closed without it here.
"""

from __future__ import annotations

import contextlib
import logging
import math
import re
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

KEYS = ("rate", "motors", "serial", "battery")
"""Of the table [driver]."""
MOST = 32.767
"""m, m/s and m/s^2 of a set-point: 16 bits of millimetres."""
G = 9.81
"""m/s^2 of the firmware's unit of acceleration."""
FULL = 65535.0
"""Of a motor's command."""
LEVEL = (0.0, 0.0, 0.0, 1.0)
"""(x, y, z, w) of set-points: the x axis is ahead."""
TICK_MS = 10
"""Of the firmware's logging: periods are multiples."""
PLACE, HEALTH = "place", "health"
STATE = "stateEstimate."
BLOCKS = {
    "inertia": tuple(f"{own}.{axis}" for own in ("acc", "gyro") for axis in AXES),
    "attitude": (*(f"{STATE}q{part}" for part in "wxyz"), *(f"motor.m{i}" for i in (1, 2, 3, 4))),
    HEALTH: (
        "supervisor.info",
        "pm.vbat",
        "pm.batteryLevel",
        "kalman.varPX",
        "kalman.varPY",
        "kalman.varPZ",
    ),
    PLACE: (*(f"{STATE}{axis}" for axis in AXES), *(f"{STATE}v{axis}" for axis in AXES)),
}
"""Variables of the firmware's log, at most 26 bytes a block."""
HEALTH_MS = 100
"""Between two packets of that block."""
STAMP = 1 << 24
"""ms after which the firmware's stamps begin again."""
ARMED, CAN_FLY, FLIES = 1, 3, 4
"""Bits of supervisor.info."""
FALLEN = {6: "locked until it is restarted", 7: "crashed", 5: "tumbled"}
"""Bits of supervisor.info, and their words."""
FACTORY = "E7E7E7E7E7"
"""Address of every Crazyflie as it is sold."""
CONNECT_S, ANSWER_S = 30.0, 3.0
"""For the tables of the firmware; for an answer of it."""
BRAKE_S = 1.0
"""In which the high-level commander comes to rest."""
SHORTEST_LANDING_S, LANDING_SPEED = 2.0, 0.3
"""s, m/s"""
UNCERTAIN = 0.1
"""m of standard deviation of its own estimate."""


def driver(joints: tuple[str, ...], address: str, settings: Mapping[str, Any]) -> CrazyflieVehicle:
    """`--on crazyflie:radio://0/80/2M/E7E7E7E701`, an address of cflib; [driver] has `KEYS`."""
    if not address:
        raise UsageError("crazyflie needs an address", next_step="--on crazyflie:radio://0/80/2M/E7E7E7E701")
    needed("cflib.crtp", "the driver crazyflie")
    return CrazyflieVehicle(joints, address, settings)


class CrazyflieVehicle:
    """A Stream over cflib.

    Args:
        joints: of the campaign: x, y and z. address: of cflib.
        settings: rate, Hz; motors, names of the campaign's commands of m1 to m4; serial, that of its
            processor, without which the factory's address names no robot; battery, least part of the charge
            with which a motion begins.
        virtual: of a simulation, whose time advances with set-points.

    Raises:
        UsageError: another axis, key, rate or number of motors; nothing identifies this Crazyflie.
    """

    def __init__(
        self, joints: Sequence[str], address: str, settings: Mapping[str, Any], virtual: bool = False
    ) -> None:
        require_known(settings, KEYS, "crazyflie")
        require_axes(joints, "crazyflie")
        self.address, self.virtual = address, virtual
        self.rate = float(settings.get("rate", 50.0))
        self.motors = tuple(settings.get("motors", ("m1", "m2", "m3", "m4")))
        self.serial = str(settings.get("serial", ""))
        self.battery = float(settings.get("battery", 0.3))
        self._require_stated()
        self._cf: Any = None
        self._news, self._lock = threading.Condition(), threading.Lock()
        self._newest: dict[str, float] = {}
        self._stamp: int | None = None
        self._t = self._returned_t = -1.0
        self._serves = False
        self._ground: float | None = None  # m, where it stood before this driver lifted it
        self._held: Array | None = None  # (3,) set-point at rest that was sent last

    def _require_stated(self) -> None:
        periods = 1e3 / self.rate / TICK_MS if self.rate > 0.0 else 0.0
        if not 1.0 <= periods <= 10.0 or abs(periods - round(periods)) > 1e-3:
            raise UsageError(
                f"a Crazyflie logs every {TICK_MS} ms or a multiple of it, so {self.rate:g} Hz is not "
                "possible",
                where="run.toml",
                next_step="Write rate = 50 under [driver]: it may be 100, 50, 25, 20 or 10.",
            )
        if len(self.motors) != 4:
            raise UsageError(
                f"motors names {len(self.motors)} commands, and a Crazyflie has four motors",
                where="run.toml",
                next_step="Name four commands of robot.toml, in the order m1 to m4.",
            )
        named = re.search(r"radio://[^/]*/[^/]*/[^/]*/([0-9A-Fa-f]{10})", self.address)
        alike = self.address.startswith(("radio:", "usb:")) and (named is None or named[1].upper() == FACTORY)
        if alike and not self.serial:
            raise UsageError(
                f"any Crazyflie may answer at {self.address}, so this address identifies no robot",
                where="run.toml",
                next_step='Write serial = "?" under [driver], and run once with --dry-run, which shows '
                "the right one.",
            )

    def about(self) -> About:
        ones = np.ones(3)
        named = f" {self.serial}" if self.serial else ""
        return About(
            name="Crazyflie",
            identity=f"crazyflie{named} at {self.address}",
            joints=AXES,
            rate=self.rate,
            command_unit="1",
            command_of="applied",
            gravity_in_command=True,
            lower=-MOST * ones,
            upper=MOST * ones,
            velocity=MOST * ones,
            acceleration=MOST * ones,
            can_hold=True,
            stopping_time=2 * BRAKE_S,
            on_loss="falls",
            silence=0.25,
            real=not self.virtual,
            virtual=self.virtual,
        )

    def __enter__(self) -> Self:
        self._cf = connected(self.address)
        try:
            self._require_serial()
            self._log()
            self._wait(lambda: PLACE in self._newest and HEALTH in self._newest, "say where it is")
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        """Lands what this driver has lifted; what it found in the air hovers."""
        self.stop()
        try:
            self._land()
        finally:
            self._close()

    def state(self) -> Sample:
        """The newest place with what else was heard until then; it waits for the next one."""
        with self._news:
            if not self.virtual:
                self._news.wait_for(lambda: self._t != self._returned_t, 1.0 / self.rate)
            self._returned_t, readings = self._t, dict(self._newest)
        q, qd = (np.array([readings[f"{STATE}{order}{axis}"] for axis in AXES]) for order in ("", "v"))
        reference = None if self._serves else self._held
        return Sample(
            self._returned_t,
            q,
            None,
            qd,
            reference,
            fault=self._fault(readings),
            extra=self._log_columns(readings),
        )

    def ready(self, control: Control) -> None:
        """Armed where that is asked for, and able to fly. ConnectionError: it is not, and why."""
        readings = self._newest
        here = self.state().q if self._held is None else self._held
        self._require_fit(readings)
        flew = self._bit(readings, FLIES)
        if not self._bit(readings, ARMED):
            self._cf.supervisor.send_arming_request(True)
        self._until(lambda: self._bit(self._newest, CAN_FLY), here, "become able to fly")
        if not flew:
            self._ground = float(self.state().q[2])
        self._held, self._serves = None, True

    def send(self, q: Array, qd: Array, qdd: Array, effort: Array | None) -> None:
        with self._lock:
            if self._serves:
                self._set_point(q, qd, qdd)
                self._held = None if qd.any() else q.copy()

    def stop(self, kill: bool = False) -> None:
        """Hovers where it comes to rest. A thread of its own sends: a signal may come in cflib's locks."""
        thread = threading.Thread(target=self._hover, daemon=True)
        thread.start()
        thread.join(0.2)

    def _hover(self) -> None:
        with self._lock, contextlib.suppress(Exception):
            if not self._serves:
                return
            self._serves = False
            readings = self._newest
            q, qd = (np.array([readings[f"{STATE}{order}{axis}"] for axis in AXES]) for order in ("", "v"))
            goal = q + 0.5 * BRAKE_S * qd if self._held is None else self._held
            self._cf.high_level_commander.go_to(*goal.tolist(), yaw=0.0, duration_s=BRAKE_S)
            self._cf.commander.send_notify_setpoint_stop()

    def _land(self) -> None:
        """Down to where it stood. It lands by itself, if this program is interrupted meanwhile."""
        readings = self._newest
        if self._ground is None or not self._bit(readings, FLIES) or self._fall_reason(readings):
            return
        high = max(readings[f"{STATE}z"] - self._ground, 0.0)
        seconds = max(SHORTEST_LANDING_S, high / LANDING_SPEED)
        self._cf.high_level_commander.land(self._ground, seconds, yaw=0.0)
        end = time.monotonic() + (0.0 if self.virtual else seconds + ANSWER_S)
        while self._bit(self._newest, FLIES) and time.monotonic() < end:
            time.sleep(0.05)
        self._ground = None

    def _close(self) -> None:
        close(self._cf)
        self._newest, self._stamp, self._held, self._ground = {}, None, None, None

    def _require_serial(self) -> None:
        if not self.serial:
            return
        serial = "".join(f"{int(self._cf.param.get_value(f'cpu.id{i}')):08X}" for i in (0, 1, 2))
        if serial != self.serial.upper():
            raise UsageError(
                f"at {self.address} is the Crazyflie {serial}, but [driver] states {self.serial}",
                where="run.toml",
                next_step=f'If it is the right one, write serial = "{serial}" under [driver].',
            )

    def _log(self) -> None:
        log = needed("cflib.crazyflie.log", "the driver crazyflie")
        for name, variables in BLOCKS.items():
            block = log.LogConfig(name, HEALTH_MS if name == HEALTH else round(1e3 / self.rate))
            for variable in variables:
                block.add_variable(variable)
            try:
                self._cf.log.add_config(block)
            except KeyError as error:
                raise ConnectionError(
                    f"its firmware does not log what a position needs: {error.args[0]}"
                ) from error
            block.data_received_cb.add_callback(self._receive)
            block.start()

    def _receive(self, stamp: int, values: Mapping[str, float], block: Any) -> None:
        """In cflib's thread. stamp: ms, 24 bits."""
        with self._news:
            self._newest |= values
            self._newest[block.name] = 1.0
            if block.name == PLACE:
                passed = 0 if self._stamp is None else (stamp - self._stamp + STAMP // 2) % STAMP - STAMP // 2
                self._t = stamp / 1e3 if self._stamp is None else self._t + passed / 1e3
                self._stamp = stamp
            self._news.notify_all()

    def _wait(self, true: Callable[[], bool], action: str) -> None:
        with self._news:
            if not self._news.wait_for(true, ANSWER_S):
                raise ConnectionError(f"{self.address} did not {action} within {ANSWER_S:g} s")

    def _until(self, true: Callable[[], bool], here: Array, action: str) -> None:
        """While set-points go on, which keep a hovering one where it is."""
        for _ in range(round(ANSWER_S * self.rate)):
            if true():
                return
            self._set_point(here, np.zeros(3), np.zeros(3))
            self.state()
        raise ConnectionError(f"it did not {action} within {ANSWER_S:g} s")

    def _set_point(self, q: Array, qd: Array, qdd: Array) -> None:
        """To the nearest millimetre: cflib cuts."""
        rows = np.array([q, qd, qdd])
        place, speed, force = ((np.rint(1e3 * rows) + 0.25 * np.sign(rows)) / 1e3).tolist()
        self._cf.commander.send_full_state_setpoint(place, speed, force, LEVEL, 0.0, 0.0, 0.0)

    def _require_fit(self, readings: Mapping[str, float]) -> None:
        """ConnectionError: no motion may begin, and why."""
        if fallen := self._fall_reason(readings):
            raise ConnectionError(f"it is {fallen}")
        require_charge(readings["pm.batteryLevel"] / 100.0, self.battery)
        if (off := math.sqrt(max(readings[f"kalman.varP{axis}"] for axis in "XYZ"))) > UNCERTAIN:
            raise ConnectionError(
                f"it knows its position to {off:.2g} m only: wait, or check its positioning"
            )
        require_heading(yaw_of(*(readings[f"{STATE}q{part}"] for part in "wxyz")))

    def _fault(self, readings: Mapping[str, float]) -> str:
        """Why it does not follow any more, once it should."""
        if not self._serves or (self._bit(readings, CAN_FLY) and not self._fall_reason(readings)):
            return ""
        return f"the firmware has stopped the rotors: it is {self._fall_reason(readings) or 'not armed'}"

    def _fall_reason(self, readings: Mapping[str, float]) -> str:
        return next((reason for bit, reason in FALLEN.items() if self._bit(readings, bit)), "")

    def _bit(self, readings: Mapping[str, float], bit: int) -> bool:
        return bool(int(readings["supervisor.info"]) >> bit & 1)

    def _log_columns(self, readings: Mapping[str, float]) -> dict[str, float]:
        """Measurements to learn from, by log column."""
        if "inertia" not in readings or "attitude" not in readings:
            return {}
        columns = {f"specific_force_{axis}": G * readings[f"acc.{axis}"] for axis in AXES}
        columns |= {f"rates_{axis}": math.radians(readings[f"gyro.{axis}"]) for axis in AXES}
        columns |= {f"orientation_{part}": readings[f"{STATE}q{part}"] for part in "wxyz"}
        columns |= {
            f"command_{name}": readings[f"motor.m{i}"] / FULL for i, name in enumerate(self.motors, 1)
        }
        return columns | {"battery_voltage_pack": readings["pm.vbat"]}


def connected(address: str) -> Any:
    """A Crazyflie of cflib with its tables. ConnectionError: none answers."""
    crtp = needed("cflib.crtp", "the driver crazyflie")
    crazyflie = needed("cflib.crazyflie", "the driver crazyflie")
    if not crtp.CLASSES:
        crtp.init_drivers()
    logging.getLogger("cflib").setLevel(logging.CRITICAL)  # what fails is an exception here
    cf, over, why = crazyflie.Crazyflie(), threading.Event(), [f"nothing answered within {CONNECT_S:g} s"]

    def failed(_: str, message: str) -> None:
        why[0] = message.strip().splitlines()[0]
        over.set()

    cf.connection_failed.add_callback(failed)
    cf.connection_lost.add_callback(failed)
    cf.fully_connected.add_callback(lambda _: over.set())
    cf.open_link(address)
    if over.wait(CONNECT_S) and cf.link is not None:
        return cf
    close(cf)
    raise ConnectionError(f"no Crazyflie at {address}: {why[0]}")


def close(cf: Any) -> None:
    """Closes the link of a Crazyflie. cflib's `close_link` alone would first send a thrust of zero."""
    link, cf.link = cf.link, None
    if link is not None:
        link.close()
    cf.close_link()
