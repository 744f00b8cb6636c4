"""A Crazyflie that speaks the part of CRTP that the driver uses, in the bytes of the firmware's sources.

Of the firmware (August 2026) are: packets, tables, priorities of set-points, the planner of the high-level
commander, the watchdog, and that it cannot fly again once it has fallen. It follows with a lag. Its time
advances by one cycle with each set-point, or in real time behind a UDP socket.
"""

from __future__ import annotations

import math
import queue
import socket
import struct
import threading
import time
from typing import Any

import cflib.crtp
import numpy as np
from cflib.crtp.crtpdriver import CRTPDriver
from cflib.crtp.crtpstack import CRTPPacket
from cflib.crtp.exceptions import WrongUriType

RATE = 50.0
LAG = 0.04
"""s"""
LEVELS, FALLS = 0.5, 2.0
"""s after the last set-point."""
LOW, HIGH = 2, 1
"""Priorities of set-points: of the radio's, and of the high-level commander's."""
IDLE, FLYING, LANDING = 0, 1, 2
"""Of the planner of the high-level commander."""
HOVER = 30000
"""Of 65535: a motor in the air."""
FLOAT, U8, U16, U32 = 7, 1, 2, 3
SIZES = {FLOAT: "<f", U8: "<B", U16: "<H", U32: "<I"}
LOGGED = {
    **{f"stateEstimate.{part}": FLOAT for part in ("x", "y", "z", "vx", "vy", "vz", "qw", "qx", "qy", "qz")},
    **{f"{group}.{axis}": FLOAT for group in ("acc", "gyro") for axis in "xyz"},
    **{f"motor.m{i}": U16 for i in (1, 2, 3, 4)},
    **{f"kalman.varP{axis}": FLOAT for axis in "XYZ"},
    **{"pm.vbat": FLOAT, "pm.batteryLevel": U8, "supervisor.info": U16},
}
"""Variables of the log, and their types there."""
SERIAL = (0x00360028, 0x3133510F, 0x37363434)
PARAMETERS = {f"cpu.id{i}": value for i, value in enumerate(SERIAL)}


class StandIn:
    """The vehicle; place and speed (3,) m, m/s, z up.

    charge: per cent. yaw: rad. known: m of standard deviation. arming: it has to be armed; locked: it has
    fallen. lacks: a variable that this firmware does not log.
    """

    def __init__(
        self,
        charge: int = 90,
        yaw: float = 0.0,
        known: float = 0.01,
        arming: bool = False,
        locked: bool = False,
        lacks: str = "",
    ) -> None:
        self.charge, self.yaw, self.known, self.locked = charge, yaw, known, locked
        self.armed, self.auto = not arming, not arming
        self.now = 16777.0  # the stamps begin again soon
        self.place, self.speed = np.array([0.4, 0.2, 0.0]), np.zeros(3)
        self.goal: np.ndarray | None = None  # (3, 3) of the set-point in force; None: rotors off
        self.priority, self.planner, self.heard_at = 0, IDLE, self.now
        self.plan: tuple[float, float, np.ndarray, np.ndarray, np.ndarray] | None = None
        self.rates: list[tuple[int, int, list[str]]] = []  # id, period in 10 ms, variables
        self.waiting: dict[int, list[str]] = {}
        self.silent = self.fell = self.thrust_of_zero = False
        self.names = [name for name in LOGGED if name != lacks]

    @property
    def flies(self) -> bool:
        return self.goal is not None and not self.locked

    def heard(self, data: bytes, advances: bool) -> list[bytes]:
        """What it answers to one packet: a header of port and channel, and up to 30 bytes."""
        port, channel, own = data[0] >> 4, data[0] & 3, data[1:]
        answers: dict[int, Any] = {
            2: self._parameters,
            4: lambda _, own: [own[:1] + b"\0"],
            5: self._log,
            9: self._supervisor,
            13: lambda _, own: [own[:1] + struct.pack("<i", 12)],
            15: lambda channel, own: [own] if channel == 0 else [b"Bitcraze Crazyflie\0"],
        }
        if port in answers:
            found = [data[:1] + answer for answer in answers[port](channel, own)]
            begins = advances and (port, channel, own[0]) == (5, 1, 3)  # a block of the log
            return [*found, self._packet(own[1], self.waiting[own[1]])] if begins else found
        {3: self._thrust, 7: self._generic, 8: self._high}[port](channel, own)
        cycles = 150 if (port, channel) == (7, 1) else int(port == 7)
        if self.planner == LANDING and self.plan is not None:
            cycles = round(RATE * self.plan[1]) + 20
        return [packet for _ in range(cycles * advances) for packet in self.step(1.0 / RATE)]

    def _generic(self, channel: int, own: bytes) -> None:
        if channel == 1:
            assert own == struct.pack("<BI", 0, 0)
            self.priority = HIGH
            return
        assert len(own) == 1 + 9 * 2 + 4 + 3 * 2
        kind, *parts = struct.unpack("<B9hI3h", own)
        assert (kind, parts[9], parts[10:]) == (6, 3 << 30, [0, 0, 0]), "level, and no rates"
        self._takes(np.array(parts[:9]).reshape(3, 3) / 1e3, LOW)

    def _thrust(self, channel: int, own: bytes) -> None:
        assert (channel, struct.unpack("<fffH", own)[3]) == (0, 0)
        self.thrust_of_zero = True
        self._takes(None, LOW)

    def _takes(self, goal: np.ndarray | None, priority: int) -> None:
        if priority < self.priority:
            return
        if self.flies and goal is None and self.place[2] > 0.05:
            self.fell = True
        self.goal, self.priority, self.heard_at = goal, priority, self.now
        if priority == LOW:
            self.planner = IDLE

    def _high(self, channel: int, own: bytes) -> None:
        if own[0] == 12:
            _, _, relative, linear, x, y, z, yaw, span = struct.unpack("<BBBBfffff", own)
            assert (relative, linear, yaw) == (0, 0, 0.0)
            self.planner, end = FLYING, np.array([x, y, z])
        else:
            kind, _, high, yaw, current, span = struct.unpack("<BBff?f", own)
            assert (kind, yaw, current) == (8, 0.0, False)
            self.planner, end = LANDING, np.array([*self.place[:2], high])
        self.plan = self.now, span, self.place, self.speed, end

    def _planned(self) -> np.ndarray | None:
        """(3, 3) of the high-level commander now; None: it wants the rotors off."""
        if self.planner == IDLE or self.plan is None:
            return None
        began, span, start, speed, end = self.plan
        u = min((self.now - began) / span, 1.0)
        if u == 1.0 and self.planner == LANDING:
            self.planner = IDLE
        a = end - start - span * speed  # a cubic from there to rest
        b = -span * speed - 2 * a
        return np.array([start + u * span * speed + u * u * ((a - b) + u * b), 0 * start, 0 * start])

    def _supervisor(self, channel: int, own: bytes) -> list[bytes]:
        assert (channel, own[0]) == (1, 1)
        self.armed = bool(own[1]) and not self.locked
        return [bytes([0x81, self.armed, self.armed])]

    def _parameters(self, channel: int, own: bytes) -> list[bytes]:
        if channel == 1:
            (number,) = struct.unpack("<H", own)
            return [own + b"\0" + struct.pack("<I", [*PARAMETERS.values()][number])]
        return self._table(own, dict.fromkeys(PARAMETERS, 74), b"")

    def _table(self, own: bytes, names: dict[str, int], more: bytes) -> list[bytes]:
        if own[0] == 3:
            return [own + struct.pack("<HI", len(names), 0x1234ABCD) + more]
        (number,) = struct.unpack("<H", own[1:])
        name, kind = [*names.items()][number]
        return [own + bytes([kind]) + name.replace(".", "\0").encode() + b"\0"]

    def _log(self, channel: int, own: bytes) -> list[bytes]:
        if channel == 0:
            return self._table(own, {name: LOGGED[name] for name in self.names}, bytes([16, 128]))
        if own[0] == 5:
            self.rates, self.waiting = [], {}
        elif own[0] in (6, 7):
            wanted = [struct.unpack("<BH", own[i : i + 3]) for i in range(2, len(own), 3)]
            assert all(kind & 15 == LOGGED[self.names[number]] for kind, number in wanted)
            self.waiting.setdefault(own[1], []).extend(self.names[number] for _, number in wanted)
        elif own[0] == 3:
            self.rates.append((own[1], own[2], self.waiting[own[1]]))
        return [own[:2] + b"\0" if len(own) > 1 else own + b"\0\0"]

    def step(self, seconds: float) -> list[bytes]:
        """One cycle, and what it logs of it."""
        before, beginning = self.place, self.now
        self.now += seconds
        if self.priority < LOW and self.planner != IDLE:
            self._takes(self._planned(), HIGH)
        elif self.priority == HIGH:
            self._takes(None, HIGH)  # an idle planner wants the rotors off
        age = self.now - self.heard_at
        if self.flies and age > FALLS:
            self.locked = self.fell = True
        if self.flies and self.armed and self.goal is not None and age <= LEVELS:
            self.place = before + (self.goal[0] - before) * (1.0 - math.exp(-seconds / LAG))
        elif not self.flies and before[2] > 0.0:
            self.place = before * [1, 1, 0]
        self.speed = (self.place - before) / seconds
        if np.abs(self.speed).max() < 1e-4:
            self.speed = np.zeros(3)
        due = [
            (number, names)
            for number, period, names in self.rates
            if int(self.now * 100 / period + 1e-6) != int(beginning * 100 / period + 1e-6)
        ]
        return [] if self.silent else [self._packet(number, names) for number, names in due]

    def _packet(self, number: int, names: list[str]) -> bytes:
        stamp, values = round(1e3 * self.now) % (1 << 24), self._values()
        data = b"".join(struct.pack(SIZES[LOGGED[name]], values[name]) for name in names)
        assert len(data) <= 26
        return bytes([5 << 4 | 2, number]) + struct.pack("<I", stamp)[:3] + data

    def _values(self) -> dict[str, float]:
        half, flies = 0.5 * self.yaw, self.flies and self.armed
        bits = {1: self.armed, 2: self.auto, 3: self.armed and not self.locked, 4: flies, 6: self.locked}
        own = dict(zip(("x", "y", "z", "vx", "vy", "vz"), (*self.place, *self.speed), strict=True))
        own |= {"qw": math.cos(half), "qx": 0.0, "qy": 0.0, "qz": math.sin(half)}
        found = {f"stateEstimate.{name}": float(value) for name, value in own.items()}
        found |= {"acc.x": 0.01, "acc.y": 0.02, "acc.z": 1.0, "gyro.x": 1.0, "gyro.y": 2.0, "gyro.z": 3.0}
        found |= {f"motor.m{i}": HOVER + i if flies else 0 for i in (1, 2, 3, 4)}
        found |= {f"kalman.varP{axis}": self.known**2 for axis in "XYZ"}
        info = sum(1 << bit for bit, true in bits.items() if true)
        return found | {"pm.vbat": 3.9, "pm.batteryLevel": self.charge, "supervisor.info": info}


VEHICLES: list[StandIn] = []


def address_of(vehicle: StandIn) -> str:
    """For cflib in this process, in virtual time."""
    if not cflib.crtp.CLASSES:
        cflib.crtp.init_drivers()
    if Link not in cflib.crtp.CLASSES:
        cflib.crtp.CLASSES.append(Link)
    VEHICLES.append(vehicle)
    return f"stand-in://{len(VEHICLES) - 1}"


class Link(CRTPDriver):
    """A link of cflib to a vehicle of this process. A set-point returns once cflib has read its answers."""

    def __init__(self) -> None:
        super().__init__()
        self.needs_resending = False
        self.came: queue.Queue[CRTPPacket | None] = queue.Queue()

    def connect(self, uri: str, *_: object) -> None:
        if not uri.startswith("stand-in://"):
            raise WrongUriType
        self.vehicle = VEHICLES[int(uri.rpartition("/")[2])]

    def send_packet(self, packet: CRTPPacket) -> None:
        for data in self.vehicle.heard(bytes([packet.get_header(), *packet.data]), advances=True):
            self.came.put(CRTPPacket(data[0], data[1:]))
        if packet.port in (7, 8):
            self.came.join()

    def receive_packet(self, wait: float = 0) -> CRTPPacket | None:
        if self.came.unfinished_tasks > self.came.qsize():
            self.came.task_done()  # the one before has been worked on
        try:
            return self.came.get(timeout=wait)
        except queue.Empty:
            return None

    def close(self) -> None:
        self.came.put(None)

    def get_name(self) -> str:
        return "stand-in"


class OverUdp:
    """The vehicle behind a socket, in real time. Use as a context."""

    def __init__(self, vehicle: StandIn) -> None:
        self.vehicle = vehicle
        self._own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._own.bind(("127.0.0.1", 0))
        self._own.settimeout(0.002)
        self.address = f"udp://127.0.0.1:{self._own.getsockname()[1]}"
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> OverUdp:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self._own.close()

    def _run(self) -> None:
        due, to = time.monotonic(), None
        while not self._over.is_set():
            out: list[bytes] = []
            try:
                data, to = self._own.recvfrom(64)
                out += self.vehicle.heard(data, advances=False)
            except TimeoutError:
                pass
            if time.monotonic() >= due:
                due += 1.0 / RATE
                out += self.vehicle.step(1.0 / RATE)
            for packet in out if to else ():
                self._own.sendto(packet, to)
