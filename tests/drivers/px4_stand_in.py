"""A multirotor that speaks the part of PX4's MAVLink that the driver uses, in bytes that pymavlink packs.

From the protocol's and PX4's documentation: offboard mode only after set-points at more than 2 Hz, left for
hold when they end; arming refused with a sentence; set-points in north, east, down. It follows with a lag.
Without a socket its time advances by one cycle with each set-point.
"""

from __future__ import annotations

import math
import socket
import threading
import time
from collections import deque
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

OFFBOARD, HOLD, LAND, POSITION = 6 << 16, 4 << 16 | 3 << 24, 4 << 16 | 6 << 24, 3 << 16
RATE = 50.0
LOST_S = 0.5
"""s without a set-point after which PX4 leaves offboard mode: COM_OF_LOSS_T is 1 by default."""
LAG = 0.04
"""s"""


class StandIn:
    """The vehicle. north, east, down and their rates: (3,) m, m/s.

    kind: MAV_TYPE. refuses: why it would not arm. charge: per cent. yaw: rad from north, clockwise.
    """

    def __init__(self, kind: int = 2, refuses: str = "", charge: int = 90, yaw: float = math.pi / 2) -> None:
        self.kind, self.refuses, self.charge, self.yaw = kind, refuses, charge, yaw
        self.now, self.mode, self.armed = 12.0, HOLD, False
        self.place, self.speed = np.array([0.2, 0.4, -1.1]), np.zeros(3)
        self.asked = np.array([*self.place, *np.zeros(6)])
        self.points: deque[float] = deque(maxlen=20)
        self.said: list[tuple[int, Any]] = []
        self.silent = False
        self._pack = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)

    def heard(self, message: Any, advances: bool) -> bytes:
        """What it answers."""
        kind, out = message.get_type(), b""
        if kind == "SET_POSITION_TARGET_LOCAL_NED":
            own = message
            assert (own.coordinate_frame, own.type_mask, own.yaw) == (1, 2048, np.float32(math.pi / 2))
            self.points.append(self.now)
            if self.mode == OFFBOARD:
                self.asked = np.array(
                    [own.x, own.y, own.z, own.vx, own.vy, own.vz, own.afx, own.afy, own.afz]
                )
            return self.step(1.0 / RATE) if advances else b""
        if kind != "COMMAND_LONG":
            return out
        self.said.append((message.command, (message.param1, message.param2, message.param3)))
        result = 0
        if message.command == 176:
            mode = int(message.param2) << 16 | int(message.param3) << 24
            streamed = len(self.points) >= 3 and self.now - self.points[0] >= 0.3
            if mode == OFFBOARD and not streamed:
                result = 1
            else:
                out += self.enters(mode, advances)
        if (message.command, message.param1) == (512, 0):
            out += self.beat()
        if message.command == 400 and message.param1 and self.refuses:
            result = 1
            out += self._packed("statustext", 3, self.refuses.encode())
        elif message.command == 400:
            self.armed = bool(message.param1)
        return out + self._packed("command_ack", message.command, result)

    def enters(self, mode: int, advances: bool = False) -> bytes:
        """A mode; of hold and landing, the way to rest."""
        self.mode, out = mode, b""
        if mode != OFFBOARD:
            self.asked = np.array([*(self.place + 0.1 * self.speed), *np.zeros(6)])
            out = b"".join(self.step(1.0 / RATE) for _ in range(50 if advances else 0))
        return out

    def step(self, seconds: float) -> bytes:
        """One cycle, and what it sends of it."""
        self.now += seconds
        before = self.place
        self.place = before + (self.asked[:3] - before) * (1.0 - math.exp(-seconds / LAG))
        self.speed = (self.place - before) / seconds
        if np.abs(self.speed).max() < 1e-4:
            self.speed = np.zeros(3)
        out = b""
        if self.mode == OFFBOARD and self.points and self.now - self.points[-1] > LOST_S:
            out += self.enters(HOLD)
        if int(self.now) != int(self.now - seconds):  # PX4 sends them once a second, and when it is asked to
            out += self.beat()
        return out if self.silent else out + self.telemetry()

    def telemetry(self) -> bytes:
        ms, half = round(1e3 * self.now), 0.5 * self.yaw
        force = np.array([0.1, 0.2, -9.8])
        return b"".join(
            (
                self._packed("attitude_quaternion", ms, math.cos(half), 0, 0, math.sin(half), 0, 0, 0),
                self._packed(
                    "highres_imu", 1000 * ms, *force, 0.01, 0.02, 0.03, *(0.0,) * 7, fields_updated=63
                ),
                self._packed(
                    "actuator_output_status", 1000 * ms, 4, [1400.0, 1500.0, 1600.0, 1700.0] + [0.0] * 28
                ),
                self._packed("sys_status", 0, 0, 0, 0, 15800, -1, self.charge, 0, 0, 0, 0, 0, 0),
                self._packed("local_position_ned", ms, *self.place, *self.speed),
            )
        )

    def beat(self) -> bytes:
        return (
            b""
            if self.silent
            else self._packed("heartbeat", self.kind, 12, 1 | (128 if self.armed else 0), self.mode, 4)
        )

    def _packed(self, name: str, *values: Any, **named: Any) -> bytes:
        message = getattr(self._pack, f"{name}_encode")(*values, **named)
        return bytes(message.pack(self._pack))


class Wire:
    """A connection to it without a socket: what pymavlink's connections do, in virtual time."""

    def __init__(self, vehicle: StandIn) -> None:
        self.vehicle, self.came = vehicle, deque[Any]()
        self.mav = mavlink.MAVLink(self, srcSystem=255, srcComponent=190)
        self._there, self._here = mavlink.MAVLink(None), mavlink.MAVLink(None)
        self._take(vehicle.beat() + vehicle.telemetry())

    def write(self, data: bytes) -> None:
        for message in self._there.parse_buffer(data) or ():
            self._take(self.vehicle.heard(message, advances=True))

    def _take(self, data: bytes) -> None:
        self.came.extend(self._here.parse_buffer(data) or ())

    def recv_match(self, blocking: bool, timeout: float) -> Any:
        return self.came.popleft() if self.came else None

    def close(self) -> None:
        pass


class OverUdp:
    """The vehicle behind a socket, in real time. Use as a context; `port` is where it sends to."""

    def __init__(self, vehicle: StandIn, port: int) -> None:
        self.vehicle, self.to = vehicle, ("127.0.0.1", port)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> OverUdp:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        parser, due = mavlink.MAVLink(None), time.monotonic()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
            own.bind(("127.0.0.1", 0))
            own.setblocking(False)
            while not self._over.is_set():
                self._answer(own, parser)
                now = time.monotonic()
                if now >= due:
                    due += 1.0 / RATE
                    self._send(own, self.vehicle.step(1.0 / RATE))
                time.sleep(0.001)

    def _answer(self, own: socket.socket, parser: Any) -> None:
        try:
            data = own.recv(4096)
        except BlockingIOError:
            return
        for message in parser.parse_buffer(data) or ():
            self._send(own, self.vehicle.heard(message, advances=False))

    def _send(self, own: socket.socket, data: bytes) -> None:
        if data:
            own.sendto(data, self.to)
