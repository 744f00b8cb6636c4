"""Point-to-point motions: rest-to-rest quintic moves between waypoints, all axes in step."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from etude.errors import UsageError
from etude.protocols import Trajectory
from etude.trajectories.extremes import USABLE_PART
from etude.trajectories.fourier import to_text
from etude.types import Array, Motion

if TYPE_CHECKING:
    from etude._runtime.pictures import Picture

PEAK_VELOCITY = 15.0 / 8.0
"""max of s'(x) for s = x^3 (10 - 15 x + 6 x^2)."""
PEAK_ACCELERATION = 10.0 / math.sqrt(3.0)
"""max of |s''(x)|."""
PEAK_JERK = 60.0
"""max of |s'''(x)|, where a move begins and ends."""
PEAKS = ((0.0, PEAK_VELOCITY), (-PEAK_ACCELERATION, PEAK_ACCELERATION), (-30.0, PEAK_JERK))
"""Extremes of the first three derivatives of s; the fourth is not finite where a move begins."""


@dataclass(frozen=True, eq=False)
class PointToPoint:
    """Straight moves; each lasts as long as its slowest axis needs.

    Attributes:
        waypoints: (K, k) rad (m).
        peak_velocity: highest speed of a move, rad/s; float, (k,), or (K-1, k) for one row a move.
        dwell: s at rest before the first move and after every move.
        peak_acceleration: highest |qdd|, rad/s^2; float or (k,).
        peak_jerk: highest |qddd|, rad/s^3; float or (k,).

    Raises:
        UsageError: wrong shapes, values that are not finite, speeds or accelerations <= 0, negative dwell.
    """

    waypoints: Array
    peak_velocity: Array | float
    dwell: float = 0.8
    peak_acceleration: Array | float = math.inf
    peak_jerk: Array | float = math.inf

    def __post_init__(self) -> None:
        points = np.array(self.waypoints, dtype=float)
        if points.ndim != 2 or len(points) < 2 or points.shape[1] < 1 or not np.all(np.isfinite(points)):
            raise UsageError(f"waypoints must be a finite (K >= 2, axes) table, not {points.shape}")
        moves = (len(points) - 1, points.shape[1])
        for name in ("peak_velocity", "peak_acceleration", "peak_jerk"):
            object.__setattr__(self, name, _positive_table(name, getattr(self, name), moves))
        if not (math.isfinite(self.dwell) and self.dwell >= 0.0):
            raise UsageError(f"the dwell must be a number of seconds >= 0, not {self.dwell}")
        points.setflags(write=False)
        object.__setattr__(self, "waypoints", points)
        if not self.duration > 0.0:
            raise UsageError("the waypoints are all the same point and there is no dwell")

    @property
    def form(self) -> str:
        """Form in its file, which tracking margins depend on."""
        return "moves"

    @property
    def axes(self) -> int:
        """k."""
        return int(self.waypoints.shape[1])

    @property
    def times(self) -> Array:
        """(K-1,) s that each move lasts: long enough for every axis's peaks."""
        reach = np.abs(np.diff(self.waypoints, axis=0))
        by_speed = PEAK_VELOCITY * reach / self.peak_velocity
        by_acceleration = np.sqrt(PEAK_ACCELERATION * reach / self.peak_acceleration)
        by_jerk = np.cbrt(PEAK_JERK * reach / self.peak_jerk)
        return np.asarray(np.maximum(np.maximum(by_speed, by_acceleration), by_jerk).max(axis=1))

    @property
    def duration(self) -> float:
        return float(self.times.sum() + self.dwell * len(self.waypoints))

    def pieces(self) -> Sequence[tuple[float, str, Trajectory]]:
        """Itself, one segment from 0 s on."""
        return ((0.0, "segment", self),)

    def motion(self, t: Array, orders: int = 3) -> Motion:
        """Position and exact derivatives, up to jerk, at times t (T,) s; at rest outside [0, duration].

        Raises:
            UsageError: other than 1 to 4 orders.
        """
        if not 1 <= orders <= 1 + len(PEAKS):
            raise UsageError(
                f"a point-to-point motion has the orders 1 to {1 + len(PEAKS)}, not {orders}",
                where=f"motion(t, {orders})",
                next_step=f"Ask for {1 + len(PEAKS)} at most: position and its derivatives up to jerk.",
            )
        t, times = np.asarray(t, dtype=float), self.times
        starts = self.dwell + np.concatenate([[0.0], np.cumsum(times + self.dwell)[:-1]])
        k = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, len(times) - 1)
        length = np.where(times[k] > 0.0, times[k], 1.0)
        x = np.clip((t - starts[k]) / length, 0.0, 1.0)
        moving = ((x > 0.0) & (x < 1.0)).astype(float)
        step = np.diff(self.waypoints, axis=0)[k]
        # the quintic from rest to rest, and its derivatives
        rise = x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
        shapes = (
            30.0 * (x * (1.0 - x)) ** 2 / length,
            60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / length**2,
            moving * (60.0 - 360.0 * x + 360.0 * x * x) / length**3,
        )
        rates = [shape[:, None] * step for shape in shapes[: orders - 1]]
        return Motion(t, np.stack([self.waypoints[k] + rise[:, None] * step, *rates]))

    def bound(self, order: int, degree: int = 1) -> tuple[Array, Array, float]:
        """Values (M, k) that exactly enclose that derivative: no amplitudes, kappa 1.

        Moves are straight, so the same values bound the sizes of vectors and other convex functions.

        Raises:
            UsageError: an order above jerk, or a degree other than 1 and 2.
        """
        if not 0 <= order <= len(PEAKS) or degree not in (1, 2):
            raise UsageError(f"nothing bounds derivative {order}, degree {degree}, of point-to-point motions")
        still = np.zeros((1, self.axes))
        if order == 0:
            return self.waypoints, still[0], 1.0
        length = np.where(self.times > 0.0, self.times, 1.0)[:, None]
        step = np.diff(self.waypoints, axis=0)
        ends = [peak * step / length**order for peak in PEAKS[order - 1]]
        return np.concatenate([still, *ends]), still[0], 1.0

    def slowed(self, factor: float) -> PointToPoint:
        """The same moves in `factor` times the time, dwells included."""
        peaks = [
            peak / factor**order
            for order, peak in enumerate((self.peak_velocity, self.peak_acceleration, self.peak_jerk), 1)
        ]
        return PointToPoint(self.waypoints, peaks[0], self.dwell * factor, *peaks[1:])

    def plot(self, path: str | Path | None = None) -> Picture:
        """Motion over time: shown by a notebook, and saved as SVG if there is a path."""
        from etude._runtime.pictures import picture_of

        return picture_of("trajectory", self, path)

    def to_json(self) -> str:
        """The exact motion as JSON text; every float reads back to the same bits."""
        names = ["waypoints", "peak_velocity", "dwell", "peak_acceleration"]
        names += ["peak_jerk"] if np.isfinite(self.peak_jerk).any() else []
        return to_text(self.form, {name: getattr(self, name) for name in names})


def _positive_table(name: str, value: Array | float, moves: tuple[int, int]) -> Array:
    """(M, k), read-only: a value for each axis in each move. UsageError: another shape; not above 0."""
    try:
        table = np.array(np.broadcast_to(np.asarray(value, dtype=float), moves))
    except ValueError:
        raise UsageError(
            f"{name} has shape {np.shape(value)}, which does not fit {moves} moves and axes",
            next_step="Give one number, one of each axis, or one of each axis in each move.",
        ) from None
    if not np.all(table > 0.0):
        wrong = float(table[~(table > 0.0)][0])
        raise UsageError(
            f"{name} must be positive, not {wrong:g}", next_step="A size without a sign is meant."
        )
    table.setflags(write=False)
    return table


def random_moves(
    rng: np.random.Generator,
    lower: Array,
    upper: Array,
    velocity: Array,
    acceleration: Array,
    count: int,
    speed_fraction_range: tuple[float, float] = (0.4, 0.8),
    box_fraction: float = 0.8,
    dwell: float = 0.8,
    jerk: Array | float = math.inf,
) -> PointToPoint:
    """`count` moves between points drawn uniformly in the middle `box_fraction` of the position limits.

    Each move has its own speed, a fraction of the velocity limits drawn from `speed_fraction_range`;
    acceleration and jerk limits are kept. Inside all limits (k,), rad (m) and s, by construction.
    """
    low, high = speed_fraction_range
    if count < 1 or not 0.0 < low <= high <= 1.0 or not 0.0 < box_fraction <= 1.0:
        raise UsageError(
            f"random moves need count >= 1, fractions in (0, 1]: {count}, {low}..{high}, {box_fraction}"
        )
    middle, half = 0.5 * (upper + lower), 0.5 * box_fraction * (upper - lower)
    waypoints = middle + half * rng.uniform(-1.0, 1.0, (count + 1, len(middle)))
    speed = USABLE_PART * rng.uniform(low, high, (count, 1)) * velocity
    return PointToPoint(waypoints, speed, dwell, USABLE_PART * acceleration, USABLE_PART * np.asarray(jerk))
