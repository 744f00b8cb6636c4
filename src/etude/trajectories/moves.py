"""Point-to-point motions: rest-to-rest quintic moves between waypoints, all joints in step."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError
from etude.robots.spec import RobotSpec
from etude.trajectories.extremes import ROOM
from etude.trajectories.json_text import from_text, to_text
from etude.trajectories.samples import TrajectorySamples

Array = NDArray[np.float64]

PEAK_VELOCITY = 15.0 / 8.0
"""max of s'(x) for s = x^3 (10 - 15 x + 6 x^2)."""
PEAK_ACCELERATION = 10.0 / math.sqrt(3.0)
"""max of |s''(x)|."""


@dataclass(frozen=True, eq=False)
class PointToPoint:
    """Straight joint-space moves; each lasts as long as its slowest joint needs.

    Attributes:
        waypoints: (K, dof) rad (m).
        peak_velocity: highest speed of a move, rad/s; float, (dof,), or (K-1, dof) for one row a move.
        dwell: s at rest before the first move and after every move.
        peak_acceleration: highest |qdd|, rad/s^2; float or (dof,).

    Raises:
        UsageError: wrong shapes, values that are not finite, speeds or accelerations <= 0, negative dwell.
    """

    waypoints: Array
    peak_velocity: Array | float
    dwell: float = 0.8
    peak_acceleration: Array | float = math.inf

    def __post_init__(self) -> None:
        points = np.array(self.waypoints, dtype=float)
        if points.ndim != 2 or len(points) < 2 or points.shape[1] < 1 or not np.all(np.isfinite(points)):
            raise UsageError(f"waypoints must be a finite (K >= 2, joints) table, not {points.shape}")
        moves = (len(points) - 1, points.shape[1])
        for name in ("peak_velocity", "peak_acceleration"):
            object.__setattr__(self, name, _per_move(name, getattr(self, name), moves))
        if not (math.isfinite(self.dwell) and self.dwell >= 0.0):
            raise UsageError(f"the dwell must be a number of seconds >= 0, not {self.dwell}")
        points.setflags(write=False)
        object.__setattr__(self, "waypoints", points)
        if not self.duration > 0.0:
            raise UsageError("the waypoints are all the same point and there is no dwell")

    @property
    def dof(self) -> int:
        return int(self.waypoints.shape[1])

    @property
    def times(self) -> Array:
        """(K-1,) s that each move lasts: long enough for every joint's peak velocity and acceleration."""
        reach = np.abs(np.diff(self.waypoints, axis=0))
        by_speed = PEAK_VELOCITY * reach / self.peak_velocity
        by_acceleration = np.sqrt(PEAK_ACCELERATION * reach / self.peak_acceleration)
        return np.asarray(np.maximum(by_speed, by_acceleration).max(axis=1))

    @property
    def duration(self) -> float:
        return float(self.times.sum() + self.dwell * len(self.waypoints))

    def sample(self, t: Array) -> TrajectorySamples:
        """Positions and exact derivatives at times t (T,) in s; at rest outside [0, duration]."""
        t = np.asarray(t, dtype=float)
        times = self.times
        starts = self.dwell + np.concatenate([[0.0], np.cumsum(times + self.dwell)[:-1]])
        k = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, len(times) - 1)
        length = np.where(times[k] > 0.0, times[k], 1.0)
        x = np.clip((t - starts[k]) / length, 0.0, 1.0)
        moving = ((x > 0.0) & (x < 1.0)).astype(float)
        step = np.diff(self.waypoints, axis=0)[k]
        shapes = (
            30.0 * (x * (1.0 - x)) ** 2 / length,
            60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / length**2,
            moving * (60.0 - 360.0 * x + 360.0 * x * x) / length**3,
        )
        rise = x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
        q = self.waypoints[k] + rise[:, None] * step
        return TrajectorySamples(t, q, *(shape[:, None] * step for shape in shapes))

    def to_json(self) -> str:
        """The exact motion as JSON text; every float reads back to the same bits."""
        names = ("waypoints", "peak_velocity", "dwell", "peak_acceleration")
        return to_text("moves", {name: getattr(self, name) for name in names})

    @classmethod
    def from_json(cls, text: str | bytes) -> PointToPoint:
        """Inverse of `to_json`. UsageError if the text is anything else."""
        return from_text(text, {"moves": cls})


def _per_move(name: str, value: Array | float, moves: tuple[int, int]) -> Array:
    try:
        table = np.array(np.broadcast_to(np.asarray(value, dtype=float), moves))
    except ValueError:
        raise UsageError(
            f"{name} has shape {np.shape(value)}, which does not fit {moves} moves and joints"
        ) from None
    if not np.all(table > 0.0):
        raise UsageError(f"{name} must be positive")
    table.setflags(write=False)
    return table


def random_moves(
    rng: np.random.Generator,
    spec: RobotSpec,
    count: int,
    speed_fraction_range: tuple[float, float] = (0.4, 0.8),
    box_fraction: float = 0.8,
    dwell: float = 0.8,
) -> PointToPoint:
    """`count` moves between points drawn uniformly in the middle `box_fraction` of the position limits.

    Each move has its own speed, a fraction of the velocity limits drawn from `speed_fraction_range`;
    acceleration limits are kept. Inside every limit of `spec` by construction.
    """
    low, high = speed_fraction_range
    if count < 1 or not 0.0 < low <= high <= 1.0 or not 0.0 < box_fraction <= 1.0:
        raise UsageError(
            f"random moves need count >= 1, fractions in (0, 1]: {count}, {low}..{high}, {box_fraction}"
        )
    middle, half = 0.5 * (spec.upper + spec.lower), 0.5 * box_fraction * (spec.upper - spec.lower)
    waypoints = middle + half * rng.uniform(-1.0, 1.0, (count + 1, spec.dof))
    speed = ROOM * rng.uniform(low, high, (count, 1)) * spec.velocity
    return PointToPoint(waypoints, speed, dwell, ROOM * spec.acceleration)
