"""Flight: the true states of a simulated vehicle, tick by tick."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude_quadrotor.plant.core import DIVERGED, GROUND, LEFT_ROOM
from etude_quadrotor.vehicle import GRAVITY

Array = NDArray[np.float64]
REASONS = {GROUND: "hit the ground", LEFT_ROOM: "left the room", DIVERGED: "left all bounds of numbers"}


@dataclass(frozen=True)
class Ending:
    """End of a flight before its plan: s from its start, position in the world frame, m, and the reason as
    text.
    """

    time: float
    position: tuple[float, float, float]
    reason: str

    def __str__(self) -> str:
        x, y, z = self.position
        return f"the vehicle {self.reason} after {self.time:.3f} s at ({x:.2f}, {y:.2f}, {z:.2f}) m"


@dataclass(frozen=True)
class Flight:
    """True states of one flight; T ticks, fewer than planned if it ended early.

    Attributes:
        t: (T,) s.
        position, velocity: (T, 3) of the centre of mass, world frame, m, m/s.
        R_world_body: (T, 3, 3).
        rates: (T, 3) body frame, rad/s.
        rotor_speed, current: (T, 4) rad/s, A.
        voltage: (T, 4) at the motors, V.
        command: (T, 4) of the controller: V, or roll, pitch, yaw rate and thrust over full scale.
        acceleration: (T, 3) world frame, m/s^2, with noise, for the noise really moves the vehicle.
        angular_acceleration: (T, 3) body frame, rad/s^2, with noise.
        wind: (T, 3) world frame, m/s.
        supply: (T,) over nominal.
        command_names, command_unit: of the four commands.
        saturated: (T,) whether a command stood at its limit.
        source: which vehicle, and how it started.
        ended: why it ended early, or None.
    """

    t: Array
    position: Array
    velocity: Array
    R_world_body: Array
    rates: Array
    rotor_speed: Array
    current: Array
    voltage: Array
    command: Array
    acceleration: Array
    angular_acceleration: Array
    wind: Array
    supply: Array
    command_names: tuple[str, str, str, str]
    command_unit: str
    saturated: NDArray[np.bool_]
    source: str
    ended: Ending | None = None

    def __len__(self) -> int:
        return len(self.t)

    @property
    def velocity_body(self) -> Array:
        """(T, 3) of the centre over ground, body frame, m/s; what a vehicle that knows no wind believes."""
        return in_body(self.R_world_body, self.velocity)

    @property
    def acceleration_body(self) -> Array:
        """(T, 3) R_body_world a, m/s^2."""
        return in_body(self.R_world_body, self.acceleration)

    @property
    def specific_force(self) -> Array:
        """(T, 3) what an accelerometer at the centre of mass reads: R_body_world (a + g z), m/s^2."""
        return in_body(self.R_world_body, self.acceleration + np.array([0.0, 0.0, GRAVITY]))


def in_body(R_world_body: Array, rows: Array) -> Array:
    """(T, 3) vectors of the world frame, seen in the body frame."""
    return np.asarray(np.einsum("tji,tj->ti", R_world_body, rows))


def rotation(q: Array) -> Array:
    """(T, 3, 3) rotation matrices of unit quaternions (T, 4), scalar first."""
    w, x, y, z = q.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)
