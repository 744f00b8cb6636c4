"""PX4's multicopter position controller as its documentation and source describe it, on a point mass.

Written from PX4's controller diagrams, its parameter reference (defaults below) and what the firmware's
PositionControl.cpp, ControlMath.cpp and Takeoff.cpp do; no line of them is copied. Frame: north, east, down.
Arrays are (..., 3), so that many flights are flown at once.

What is simplified: the attitude follows the wanted thrust direction as one lag of 1/MC_ROLL_P, the motors as
another; the estimate of the state is exact; nothing blows. `Body.drag` is linear.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

G = 9.80665


@dataclass(frozen=True)
class Parameters:
    """Defaults of PX4's parameter reference."""

    xy_p: float = 0.95  # MPC_XY_P
    z_p: float = 1.0  # MPC_Z_P
    xy_vel: tuple[float, float, float] = (1.8, 0.4, 0.2)  # MPC_XY_VEL_P_ACC, _I_, _D_
    z_vel: tuple[float, float, float] = (4.0, 2.0, 0.0)  # MPC_Z_VEL_P_ACC, _I_, _D_
    xy_max: float = 12.0  # MPC_XY_VEL_MAX, m/s
    up_max: float = 3.0  # MPC_Z_VEL_MAX_UP, m/s
    down_max: float = 1.5  # MPC_Z_VEL_MAX_DN, m/s
    tilt_air: float = math.radians(45.0)  # MPC_TILTMAX_AIR
    tilt_landed: float = math.radians(12.0)  # MPC_TILTMAX_LND
    hover: float = 0.5  # MPC_THR_HOVER: the vehicle's own here, unless `Body.hover` says otherwise
    thrust_min: float = 0.12  # MPC_THR_MIN
    thrust_max: float = 1.0  # MPC_THR_MAX
    thrust_margin: float = 0.3  # MPC_THR_XY_MARG
    ramp: float = 3.0  # MPC_TKO_RAMP_T, s
    roll_p: float = 6.5  # MC_ROLL_P, 1/s
    rate_filter: float = 5.0  # MPC_VELD_LP, Hz, of the velocity's derivative

    def gain(self, i: int) -> Array:
        """(3,) P, I or D of the velocity."""
        return np.array([self.xy_vel[i], self.xy_vel[i], self.z_vel[i]])


@dataclass(eq=False)
class PositionControl:
    """The cascade: P on position, PID on velocity, with the set-point's velocity and acceleration added.

    Attributes:
        shape: of everything before the axis of three. given: the parameters.
        integral: (..., 3) m/s^2, nothing when the controller is started.
    """

    shape: tuple[int, ...] = ()
    given: Parameters = field(default_factory=Parameters)

    def __post_init__(self) -> None:
        self.integral: Array = np.zeros((*self.shape, 3))

    def thrust(
        self,
        state: tuple[Array, Array, Array],
        setpoint: tuple[Array, Array, Array],
        dt: float,
        up_max: Array | float | None = None,
        tilt: Array | float | None = None,
        least: Array | float | None = None,
    ) -> Array:
        """(..., 3) thrust, 1 being all of it, as a vector against gravity.

        Args:
            state: position, velocity and its filtered derivative. setpoint: position, velocity, acceleration.
            up_max, tilt, least: what the take-off ramp sets otherwise.
        """
        p = self.given
        position, velocity, rate = state
        wanted = self._velocity(position, setpoint, p.up_max if up_max is None else up_max)
        error = wanted - velocity
        asked = setpoint[2] + error * p.gain(0) + self.integral - rate * p.gain(2)
        own = p.thrust_min if least is None else least
        thrust = _collective(asked, p.hover, own, p.tilt_air if tilt is None else tilt)
        full = (thrust[..., 2] <= -p.thrust_max) & (error[..., 2] <= 0.0)
        idle = (thrust[..., 2] >= -own) & (error[..., 2] >= 0.0)
        error[..., 2] = np.where(full | idle, 0.0, error[..., 2])
        thrust = _saturated(thrust, p)
        made = thrust[..., :2] * (G / p.hover)  # what saturation leaves is taken out of the integral
        over = _norm(asked[..., :2]) > _norm(made)
        error[..., :2] -= 2.0 / p.xy_vel[0] * np.where(over, asked[..., :2] - made, 0.0)
        self.integral = self.integral + error * p.gain(1) * dt
        self.integral[..., 2] = np.clip(self.integral[..., 2], -G, G)
        return thrust

    def _velocity(
        self, position: Array, setpoint: tuple[Array, Array, Array], up_max: Array | float
    ) -> Array:
        p = self.given
        of_place = (setpoint[0] - position) * np.array([p.xy_p, p.xy_p, p.z_p])
        wanted = of_place + setpoint[1]
        wanted[..., :2] = constrained(of_place[..., :2], setpoint[1][..., :2], p.xy_max)
        wanted[..., 2] = np.minimum(np.maximum(wanted[..., 2], -up_max), p.down_max)
        return wanted


def constrained(first: Array, second: Array, most: float) -> Array:
    """first + second no longer than `most`, at the cost of the second (..., 2): ControlMath's constrainXY."""
    whole = first + second
    size = _norm(second)
    unit = second / np.maximum(size, 1e-9)
    along = (unit * first).sum(axis=-1, keepdims=True)
    spare = (first**2).sum(axis=-1, keepdims=True) - most**2
    part = first + unit * (-along + np.sqrt(np.maximum(along**2 - spare, 0.0)))
    alone = first / np.maximum(_norm(first), 1e-9) * most
    out = np.where(_norm(first) >= most, alone, part)
    return np.where(_norm(whole) <= most, whole, out)


def _collective(asked: Array, hover: float, least: Array | float, tilt: Array | float) -> Array:
    """Thrust of an acceleration: the direction of gravity less it, tilted no further than allowed."""
    z = np.stack([-asked[..., 0], -asked[..., 1], np.full(asked.shape[:-1], G)], axis=-1)
    z = z / _norm(z)
    flat = _norm(z[..., :2])
    lean = np.minimum(np.arctan2(flat[..., 0], z[..., 2]), tilt)
    side = z[..., :2] / np.maximum(flat, 1e-9)
    z = np.concatenate([side * np.sin(lean)[..., None], np.cos(lean)[..., None]], axis=-1)
    size = np.minimum((asked[..., 2] * hover / G - hover) / z[..., 2], -np.asarray(least))
    return np.asarray(z * size[..., None])


def _saturated(thrust: Array, p: Parameters) -> Array:
    """Vertical thrust first, but for a margin of the horizontal one."""
    flat = _norm(thrust[..., :2])
    kept = np.minimum(flat[..., 0], p.thrust_margin)
    z = np.maximum(thrust[..., 2], -np.sqrt(p.thrust_max**2 - kept**2))
    room = np.sqrt(np.maximum(p.thrust_max**2 - z**2, 0.0))[..., None]
    xy = thrust[..., :2] * np.minimum(1.0, room / np.maximum(flat, 1e-9))
    return np.concatenate([xy, z[..., None]], axis=-1)


def _norm(v: Array) -> Array:
    return np.asarray(np.sqrt((v * v).sum(axis=-1, keepdims=True)))  # half the time of np.linalg.norm


@dataclass(frozen=True)
class Body:
    """The vehicle: hover is the part of full thrust at which it really hovers; motors lag, s;
    drag in 1/s, of all axes or of each.
    """

    hover: float = 0.5
    motors: float = 0.05
    drag: float | tuple[float, float, float] = 0.0


@dataclass(frozen=True, eq=False)
class Flown:
    """Of B flights at times t (T,) s from the first message: (T, B, 3) m, m/s; the set-point held then."""

    t: Array
    position: Array
    velocity: Array
    setpoint: Array


def padded(tables: Sequence[Array], rate: float, before: float, after: float) -> Array:
    """(N, B, 9) rows as published: the first one, each of a table (n, 9) in turn, and the last one on.

    The last row of the longest is held for `after` seconds, that of a shorter one for longer.
    """
    most = max(map(len, tables))
    lead, tail = round(before * rate), round(after * rate)
    columns = [
        np.concatenate([np.repeat(own[:1], lead, 0), own, np.repeat(own[-1:], most - len(own) + tail, 0)])
        for own in tables
    ]
    return np.stack(columns, axis=1)


@dataclass(eq=False)
class Vehicles:
    """B vehicles and their controllers, a step of `dt` at a time.

    Attributes:
        position: (B, 3) m where they are, at rest. ground: (B,) m, down, of the centre where it stands; NaN:
            it hovers. One that begins on the ground takes off by PX4's ramp once a set-point is above it.
        given, body: the controller's and the vehicle's parameters.
        dt: s of a step of both; PX4's own is 8 to 10 ms.
    """

    position: Array
    ground: Array
    given: Parameters = field(default_factory=Parameters)
    body: Body = field(default_factory=Body)
    dt: float = 0.01

    def __post_init__(self) -> None:
        count = len(self.position)
        stands = np.abs(self.position[:, 2] - self.ground) < 0.02
        self.position = self.position.copy()
        self.velocity, self.rate_seen = np.zeros((count, 3)), np.zeros((count, 3))
        self.force = np.where(stands[:, None], 0.0, np.array([0.0, 0.0, -G]))
        self.control = PositionControl((count,), self.given)
        self.progress, self.wants = np.where(stands, 0.0, 1.0), ~stands

    def step(self, row: Array) -> None:
        """Position, velocity and acceleration (B, 9) are the set-points."""
        p, dt = self.given, self.dt
        place, speed, acceleration = row[:, :3], row[:, 3:6], row[:, 6:9].copy()
        self.wants = self.wants | (place[:, 2] < self.position[:, 2] - 1e-6)
        rises = self.wants & (self.progress < 1.0)
        self.progress = np.where(rises, np.minimum(self.progress + dt / p.ramp, 1.0), self.progress)
        flies = self.progress >= 1.0
        first = -G / p.z_vel[0]
        up = np.where(flies, p.up_max, first + self.progress * (p.up_max - first))
        acceleration[:, 2] = np.where(flies, acceleration[:, 2], 0.0)
        tilt, least = np.where(flies, p.tilt_air, p.tilt_landed), np.where(flies, p.thrust_min, 0.0)
        state = self.position, self.velocity, self.rate_seen
        thrust = self.control.thrust(state, (place, speed, acceleration), dt, up, tilt, least)
        self.control.integral[~self.wants] = 0.0
        thrust[~self.wants] = 0.0
        self._move(thrust * (G / self.body.hover))

    def _move(self, wanted: Array) -> None:
        dt = self.dt
        turn, spin = 1.0 - math.exp(-self.given.roll_p * dt), 1.0 - math.exp(-dt / self.body.motors)
        self.force = _followed(self.force, wanted, turn, spin)
        total = self.force + np.array([0.0, 0.0, G]) - np.asarray(self.body.drag) * self.velocity
        velocity = self.velocity + total * dt
        position = self.position + velocity * dt
        below = position[:, 2] >= self.ground
        position[below, 2] = self.ground[below]
        velocity[below] = np.minimum(velocity[below], np.array([np.inf, np.inf, 0.0])) * np.array(
            [0.0, 0.0, 1.0]
        )
        self.position, self.velocity = position, velocity
        kept = math.exp(-2.0 * math.pi * self.given.rate_filter * dt)
        self.rate_seen = kept * self.rate_seen + (1.0 - kept) * np.where(below[:, None], 0.0, total)


def fly(
    rows: Array,
    rate: float = 50.0,
    *,
    given: Parameters | None = None,
    body: Body | None = None,
    ground: Array | None = None,
    dt: float = 0.01,
) -> Flown:
    """What the cascade makes of set-points, from rest at the first one.

    Args:
        rows: (N, B, 9) position, velocity, acceleration, `rate` a second; each is held until the next.
        given, body, ground, dt: as of `Vehicles`; without ground all hover at their first set-points.
    """
    floor = np.full(rows.shape[1], np.nan) if ground is None else np.asarray(ground, dtype=float)
    own = Vehicles(rows[0, :, :3], floor, given or Parameters(), body or Body(), dt)
    steps = round(len(rows) / rate / dt)
    out = np.zeros((3, steps, rows.shape[1], 3))
    for k in range(steps):
        row = rows[min(int(k * dt * rate + 1e-6), len(rows) - 1)]
        out[:, k] = own.position, own.velocity, row[:, :3]
        own.step(row)
    return Flown(np.arange(steps) * dt, *out)


def _followed(force: Array, wanted: Array, turn: float, spin: float) -> Array:
    """Specific force (B, 3) a step later: its direction turns by a lag, its size by another."""
    size, asked = _norm(force), _norm(wanted)
    up = np.array([0.0, 0.0, -1.0])
    own = np.where(size > 1e-6, force / np.maximum(size, 1e-9), up)
    goal = np.where(asked > 1e-6, wanted / np.maximum(asked, 1e-9), up)
    own = own + turn * (goal - own)
    return np.asarray(own / _norm(own) * (size + spin * (asked - size)))
