"""rotorpy's vehicle behind the mock of PX4's MAVLink: --on tests/foreign/px4_rotorpy.py:vehicle."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from etude_drivers import Px4Vehicle

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "drivers")]

from px4_stand_in import HOLD, StandIn, Wire  # noqa: E402
from rotorpy_vehicle import DT, NED, Airframe, Geometric, HoverThrust, NearGround, _advance  # noqa: E402

MOTORS = ("motor_1", "motor_2", "motor_3", "motor_4")
FRD = np.array([1.0, -1.0, -1.0])


class Flying(StandIn):
    """It hovers at (0, 0, 3) m, and flies by rotorpy's SE(3) controller."""

    def __init__(self, seed: int = 0) -> None:
        super().__init__()
        self.frame, self.rng = Airframe(), np.random.default_rng(seed)
        still = self.frame.still()
        self.control = Geometric(self.frame, hover=HoverThrust(still / self.frame.full))
        self.plant, self.armed = NearGround(self.frame.parameters()), True
        self.body: dict[str, Any] = {
            "x": np.array([0.0, 0.0, 3.0]),
            "v": np.zeros(3),
            "q": np.array([0.0, 0.0, 0.0, 1.0]),
            "w": np.zeros(3),
            "wind": np.zeros(3),
            "rotor_speeds": np.full(4, still),
        }
        self.asked = np.array([*(NED @ self.body["x"]), *np.zeros(6)])
        self.motors, self.push = np.full(4, still / self.frame.full), np.array([0.0, 0.0, 9.81])
        for _ in range(500):
            self.step(0.02)

    def enters(self, mode: int, advances: bool = False) -> bytes:
        rests = bool(np.abs(self.asked[3:]).max() == 0.0)
        kept = self.asked.copy()
        out = super().enters(mode, False)
        if rests:  # hold keeps the place where it was asked to rest
            self.asked = kept
        return out + b"".join(self.step(0.02) for _ in range(50 if advances and mode == HOLD else 0))

    def step(self, seconds: float) -> bytes:
        self.now += seconds
        row = np.concatenate([NED @ self.asked[3 * i : 3 * i + 3] for i in range(3)])
        for _ in range(round(seconds / DT)):
            attitude = Rotation.from_quat(self.body["q"]).as_matrix()
            self.control.position((self.body["x"], self.body["v"], np.zeros(3)), row, 0.0, DT)
            self.motors = self.control.motors(attitude, self.body["w"], DT)
            speed = self.motors * self.frame.full
            acceleration = _advance(self.plant, self.body, speed, self.frame.lag)
            self.push = attitude.T @ (acceleration + np.array([0.0, 0.0, 9.81]))
        self.place, self.speed = NED @ self.body["x"], NED @ self.body["v"]
        beat = self.beat() if int(self.now) != int(self.now - seconds) else b""
        return beat + self.telemetry()

    def telemetry(self) -> bytes:
        if not hasattr(self, "push"):
            return super().telemetry()
        ms = round(1e3 * self.now)
        north = Rotation.from_matrix(NED @ Rotation.from_quat(self.body["q"]).as_matrix() @ np.diag(FRD))
        x, y, z, w = north.as_quat()
        force = FRD * (self.push + 0.25 * self.rng.standard_normal(3))
        rates = FRD * (self.body["w"] + 0.01 * self.rng.standard_normal(3))
        place = self.place + 0.004 * self.rng.standard_normal(3)
        speed = self.speed + 0.015 * self.rng.standard_normal(3)
        pulses = [*(1000.0 + 1000.0 * self.motors), *[0.0] * 28]
        return b"".join(
            (
                self._packed("attitude_quaternion", ms, w, x, y, z, *rates),
                self._packed("highres_imu", 1000 * ms, *force, *rates, *(0.0,) * 7, fields_updated=63),
                self._packed("actuator_output_status", 1000 * ms, 4, pulses),
                self._packed("local_position_ned", ms, *place, *speed),
            )
        )


def vehicle(joints: tuple[str, ...], address: str, settings: Mapping[str, Any]) -> Px4Vehicle:
    """In virtual time."""
    return Px4Vehicle(
        joints, "rotorpy", {"motors": MOTORS, **settings}, lambda _: Wire(Flying()), virtual=True
    )
