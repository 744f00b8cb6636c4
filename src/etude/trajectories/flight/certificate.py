"""Certificate of a flight: each limit of its FlightSpec with the extreme proved for all times."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.errors import UnsafeTrajectoryError, UsageError
from etude.robots.flight_spec import FlightSpec
from etude.robots.vehicle import GRAVITY
from etude.trajectories.certificate import OVERSAMPLING, Certificate, LimitProof
from etude.trajectories.extremes import grid, riesz_range
from etude.trajectories.flight.limits import AXES, inner_box, inner_radius, lift_room
from etude.trajectories.fourier import FourierTrajectory, series

Array = NDArray[np.float64]

TILT_STEPS = 50
"""Halvings of the interval that holds the proved tilt."""
SINGLE = f"Riesz bound from {OVERSAMPLING} samples per harmonic"
DOUBLE = f"Riesz bound of twice the degree from {OVERSAMPLING} samples per degree"


def certify_flight(trajectory: FourierTrajectory, spec: FlightSpec, *, rest: bool = False) -> Certificate:
    """Prove the limits of `spec`, less its margin, at all times.

    Thrust and tilt are those of a + g z, without drag. The vertical part of a + g z ("lift") is held within
    what flatness needs, limits or not.

    Args:
        trajectory: a Fourier flight (x, y, z) without phase ramp.
        spec: the vehicle and its room.
        rest: whether the plan must start and end at rest.

    Raises:
        UsageError: not a flight.
    """
    if trajectory.dof != 3 or trajectory.ramp > 0.0:
        raise UsageError(f"a flight has 3 axes and no phase ramp, not {trajectory.dof}, {trajectory.ramp} s")
    near, kappa = grid(trajectory.harmonics, OVERSAMPLING)
    single = _samples(trajectory, near)
    double = _samples(trajectory, grid(2 * trajectory.harmonics, OVERSAMPLING)[0])
    rows = _room_rows(single[0], double[0], double[1], spec, kappa)
    rows += _force_rows(_pushed(single[2]), _pushed(double[2]), spec, kappa)
    ends = trajectory.sample(np.array([0.0, trajectory.duration])).qd
    end_speed = float(np.linalg.norm(ends, axis=1).max()) / spec.speed if spec.speed > 0.0 else math.inf
    return Certificate(tuple(rows), end_speed, rest_needed=rest)


def require_flight_certified(
    trajectory: FourierTrajectory, spec: FlightSpec, *, rest: bool = False
) -> Certificate:
    """The certificate, if every limit is proved.

    Raises:
        UnsafeTrajectoryError: names the quantity, the limit and the proved value.
    """
    certificate = certify_flight(trajectory, spec, rest=rest)
    if certificate.ok:
        return certificate
    failed = [row for row in certificate.rows if not row.margin >= 0.0]
    if not failed:
        raise UnsafeTrajectoryError(
            f"the flight starts or ends at {certificate.end_speed:.3g} of the speed limit, not at rest",
            next_step="Use a family with rest, and a whole number of periods.",
        )
    row = min(failed, key=lambda row: row.margin)
    above = row.proved_upper - row.upper >= row.lower - row.proved_lower
    raise UnsafeTrajectoryError(
        f"{row.quantity} ({row.axis}) may reach {row.proved_upper if above else row.proved_lower:.6g}, "
        f"outside its limit {row.lower:.6g}..{row.upper:.6g}",
        where=f"{row.axis}, {row.quantity}",
        next_step="Shrink the flight towards the middle of its room, or choose another one.",
    )


@dataclass(frozen=True)
class _Samples:
    """Samples (M, 3) of a vector series, and the sum of amplitudes (3,) of each component, for rounding."""

    value: Array
    size: Array


def _samples(trajectory: FourierTrajectory, angles: Array) -> tuple[_Samples, _Samples, _Samples]:
    """Position, velocity and acceleration at phase angles (M,)."""
    rows = series(angles, trajectory.harmonics, trajectory.omega0)[:3]
    table = trajectory.coefficients
    one, two, three = (_Samples(row @ table, np.abs(row).max(axis=0) @ np.abs(table)) for row in rows)
    return one, two, three


def _pushed(acceleration: _Samples) -> _Samples:
    """a + g z."""
    up = np.array([0.0, 0.0, GRAVITY])
    return _Samples(acceleration.value + up, acceleration.size + up)


def _room_rows(
    single: _Samples, double: _Samples, velocity: _Samples, spec: FlightSpec, kappa: float
) -> list[LimitProof]:
    """Box, speed and cylinder, from positions on both grids and velocities on the finer one."""
    low, high = inner_box(spec)
    least, most = riesz_range(single.value, kappa, single.size)
    rows = [
        _two_sided(axis, "position", (low[j], high[j]), (least[j], most[j]), SINGLE)
        for j, axis in enumerate(AXES)
    ]
    rows.append(_one_sided("speed", spec.speed, _norm_range(velocity, slice(3), kappa)[1], DOUBLE))
    if spec.radius is not None:
        reached = _norm_range(double, slice(2), kappa)[1]
        rows.append(_one_sided("radius", inner_radius(spec), reached, DOUBLE))
    return rows


def _force_rows(single: _Samples, double: _Samples, spec: FlightSpec, kappa: float) -> list[LimitProof]:
    """Lift, thrust and tilt, from a + g z on both grids."""
    room = lift_room(spec)
    least, most = riesz_range(single.value, kappa, single.size)
    lift = float(least[2])
    rows = [_two_sided("vehicle", "lift", (GRAVITY - room, GRAVITY + room), (lift, float(most[2])), SINGLE)]
    if spec.thrust is not None:
        down, up = _norm_range(double, slice(3), kappa)
        rows.append(_two_sided("vehicle", "thrust", spec.thrust, (max(down, lift), up), DOUBLE))
    if spec.tilt is not None:
        rows.append(_one_sided("tilt", spec.tilt, _largest_tilt(double, kappa, lift), DOUBLE))
    return rows


def _norm_range(samples: _Samples, axes: slice, kappa: float) -> tuple[float, float]:
    """Proved interval of a vector's norm, from its square, a polynomial of twice the degree."""
    square, size = (samples.value[:, axes] ** 2).sum(axis=1), float((samples.size[axes] ** 2).sum())
    low, high = riesz_range(square[:, None], kappa, size)
    return math.sqrt(max(float(low[0]), 0.0)), math.sqrt(max(float(high[0]), 0.0))


def _largest_tilt(force: _Samples, kappa: float, lift: float) -> float:
    """Least angle b for which f = a_x^2 + a_y^2 - tan(b)^2 (a_z + g)^2 <= 0 is proved at all times.

    pi where the lift (its proved least) is not positive: f cannot tell a cone's two halves.
    """
    across, along = (force.value[:, :2] ** 2).sum(axis=1), force.value[:, 2] ** 2
    sizes = float((force.size[:2] ** 2).sum()), float(force.size[2] ** 2)

    def proved(angle: float) -> bool:
        square = math.tan(angle) ** 2
        f = (across - square * along)[:, None]
        return bool(riesz_range(f, kappa, sizes[0] + square * sizes[1])[1][0] <= 0.0)

    low, high = 0.0, 0.5 * math.pi - 1e-6
    if not lift > 0.0:
        return math.pi
    if not proved(high):
        return 0.5 * math.pi
    for _ in range(TILT_STEPS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if proved(middle) else (middle, high)
    return high


def _two_sided(
    axis: str, quantity: str, limit: tuple[float, float], proved: tuple[float, float], method: str
) -> LimitProof:
    margin = min(limit[1] - proved[1], proved[0] - limit[0])
    low, high, least, most, spare = (float(x) for x in (*limit, *proved, margin))
    return LimitProof(axis, quantity, low, high, least, most, spare, method)


def _one_sided(quantity: str, limit: float, reached: float, method: str) -> LimitProof:
    """A bound on a size, written as -limit..limit, as for a joint's velocity."""
    return LimitProof("vehicle", quantity, -limit, limit, -reached, reached, limit - reached, method)
