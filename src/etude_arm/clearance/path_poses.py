"""Distinct poses along a trajectory: clearance is a property of the path, not of time.

A Fourier motion repeats one period of its series at any speed, in ramps and repeats. Straight moves are lines
between waypoints. A property of all these poses holds at all times.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from etude.errors import UsageError
from etude.protocols import Trajectory
from etude.trajectories.extremes import riesz_range
from etude.trajectories.fourier import FourierTrajectory, phase
from etude.trajectories.moves import PointToPoint
from etude.trajectories.splined import Splined
from etude.types import Array, Index

FIRST = 128
"""Intervals to begin with."""
GRID = 4001
"""Instants at which a phase is turned round, to say when something happens."""


@dataclass(frozen=True, eq=False)
class PosePath:
    """A curve x -> pose, with bounds of its derivatives.

    Attributes:
        knots: (K,) x, increasing; the curve is smooth between them.
        at: x (T,) -> poses (T, k), rad (m), and their derivatives in x (T, k).
        bend: (k,) bound of the second derivative between knots.
        speed: (k,) bound of the first derivative between knots.
        time: x (T,) -> s, first time of the trajectory at this place.
    """

    knots: Array
    at: Callable[[Array], tuple[Array, Array]]
    bend: Array
    speed: Array
    time: Callable[[Array], Array]

    def variation(self, x: Array, poses: Array, rates: Array, left: Index, right: Index) -> Array:
        """Largest travel (I, k) of each joint between the points `left` and `right` (I,) of x.

        It is the difference of the ends if the rate cannot change sign; otherwise the bound of the bend is
        added.
        """
        step = (x[right] - x[left])[:, None]
        direct = np.abs(poses[right] - poses[left])
        turns = np.abs(rates[left]) <= self.bend * step
        bent = np.where(turns, np.where(self.bend > 0.0, 0.5 * self.bend * step**2, 0.0), 0.0)
        return np.asarray(np.minimum(direct + bent, self.speed * step))


def path_of(piece: Trajectory) -> PosePath:
    """The path of any piece of a trajectory."""
    if isinstance(piece, FourierTrajectory):
        return _of_series(piece)
    if isinstance(piece, PointToPoint):
        return _of_moves(piece)
    return _of_time(piece)


def _of_series(piece: FourierTrajectory) -> PosePath:
    """One period of the series, or the part that the motion uses."""
    span = min(2.0 * math.pi / piece.omega0, piece.duration - piece.ramp)
    path = FourierTrajectory(piece.coefficients, piece.omega0, span)
    times = np.linspace(0.0, piece.duration, GRID)
    reached = phase(times, piece.duration, piece.ramp)[0]
    return PosePath(
        np.linspace(0.0, span, FIRST + 1),
        lambda x: _two(path, x),
        largest(path, 2),
        np.full(piece.axes, np.inf),
        lambda x: np.interp(x, reached, times),
    )


def _of_moves(piece: PointToPoint) -> PosePath:
    """Lines between waypoints, with x the number of the waypoint; no joint reverses on a line."""
    points, whole = piece.waypoints, np.arange(len(piece.waypoints), dtype=float)
    each = max(FIRST // max(len(points) - 1, 1), 1)
    knots = np.linspace(0.0, whole[-1], each * (len(points) - 1) + 1)
    knots[::each] = whole  # to the last bit: an interval never holds a waypoint inside
    steps = np.diff(points, axis=0)
    starts = piece.dwell + np.concatenate([[0.0], np.cumsum(piece.times + piece.dwell)])
    part = np.linspace(0.0, 1.0, GRID)
    # the quintic by which a move goes from rest to rest
    risen = part**3 * (10.0 - 15.0 * part + 6.0 * part * part)

    def at(x: Array) -> tuple[Array, Array]:
        k = np.clip(np.floor(x).astype(int), 0, len(steps) - 1)
        return points[k] + (x - k)[:, None] * steps[k], steps[k]

    def time(x: Array) -> Array:
        k = np.clip(np.floor(x).astype(int), 0, len(steps) - 1)
        return np.asarray(starts[k] + np.interp(x - k, risen, part) * piece.times[k])

    still = np.zeros(piece.axes)
    return PosePath(knots, at, still, still + np.inf, time)


def _of_time(piece: Trajectory) -> PosePath:
    """Any other form over its whole duration, with its own bounds of speed and acceleration.

    Between set-points that are held, each joint is assumed to stay between both.
    """
    if isinstance(piece, Splined) and piece.held:
        return _of_points(piece)
    try:
        bend = largest(piece, 2)
    except UsageError:  # a form whose velocity jumps
        bend = np.full_like(largest(piece, 1), np.inf)
    knots = np.linspace(0.0, piece.duration, FIRST + 1)
    return PosePath(knots, lambda x: _two(piece, x), bend, largest(piece, 1), lambda x: x)


def _of_points(piece: Any) -> PosePath:
    """Lines between set-points; joints between the ends travel no farther."""
    times, points = np.asarray(piece.times), np.asarray(piece.points)[0]
    still = np.zeros(points.shape[1])

    def at(x: Array) -> tuple[Array, Array]:
        poses = np.stack([np.interp(x, times, column) for column in points.T], axis=1)
        return poses, np.zeros_like(poses)

    return PosePath(times, at, still, still + np.inf, lambda x: x)


def _two(piece: Trajectory, x: Array) -> tuple[Array, Array]:
    orders = piece.motion(x, 2).orders
    return orders[0], orders[1]


def largest(piece: Trajectory, order: int) -> Array:
    """Bound (k,) of the magnitude of a derivative at all times."""
    values, amplitudes, kappa = piece.bound(order, 1)
    if not np.isfinite(values).all():
        return np.full(values.shape[1], np.inf)
    low, high = riesz_range(values, kappa, amplitudes)
    return np.asarray(np.maximum(np.abs(low), np.abs(high)))
