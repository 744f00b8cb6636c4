"""The least distances along a way, proved between samples by how far joints can carry a shape.

With P_j the reach of joint j for a pair and TV_j the way that the joint makes between two samples, its
distance d is in between at least max((d_1 + d_2 - P.TV) / 2, min(d_1, d_2) - P.TV): it falls by at most P.TV
from either end. Intervals where that is less than is wanted are halved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from etude.types import Array, Index
from etude_arm.clearance.way import Way

QUICK = 4
"""One of so many of the first samples is looked at before the others: most that collide do so there."""
MOST = 20_000
"""Evaluations after which a motion counts as not proved."""


@dataclass(frozen=True, eq=False)
class Nearest:
    """The least distance of each of n gaps along a way.

    Attributes:
        proved: (n,) m, no distance is less at any time; where one is touched, the least of the samples.
        seen: (n,) m, the least of the samples. x: (n,) where that was.
        touched: whether a sample has less than was wanted.
        evaluations: poses.
    """

    proved: Array
    seen: Array
    x: Array
    touched: bool
    evaluations: int


@dataclass
class Samples:
    """Poses of a way and their distances, as they come in."""

    way: Way
    distances: Callable[[Array], Array]
    x: Array
    poses: Array
    rates: Array
    found: Array

    @classmethod
    def of(cls, way: Way, distances: Callable[[Array], Array], x: Array) -> Samples:
        poses, rates = way.at(x)
        return cls(way, distances, x, poses, rates, distances(poses))

    def add(self, x: Array) -> Index:
        """Places of the new samples."""
        more = Samples.of(self.way, self.distances, x)
        first = len(self.x)
        for name in ("x", "poses", "rates", "found"):
            setattr(self, name, np.concatenate([getattr(self, name), getattr(more, name)]))
        return np.arange(first, len(self.x))

    def bounds(self, left: Index, right: Index, reach: Array) -> Array:
        """(I, n) below which no distance falls between those samples."""
        fall = self.way.variation(self.x, self.poses, self.rates, left, right) @ reach.T
        one, other = self.found[left], self.found[right]
        return np.asarray(np.maximum(0.5 * (one + other - fall), np.minimum(one, other) - fall))

    def nearest(self, proved: Array, *, touched: bool) -> Nearest:
        least = self.found.argmin(axis=0)
        seen = self.found[least, np.arange(self.found.shape[1])]
        return Nearest(
            seen if touched else np.minimum(proved, seen), seen, self.x[least], touched, len(self.x)
        )


def nearest(
    way: Way,
    distances: Callable[[Array], Array],
    reach: Array,
    wanted: Array,
    excess: Callable[[Array], Array] | None = None,
) -> Nearest:
    """The least distances along a way, until all are proved to be `wanted` or one is found not to be.

    After `MOST` evaluations what is proved may be less than wanted: then nobody knows.

    Args:
        way: the curve.
        distances: poses (T, k) -> (T, n) m, lower bounds included.
        reach: (n, k) P: a distance changes by at most P |dq|.
        wanted: (n,) m.
        excess: poses -> (T, n) m by which distances may be too large, asked of those that all rests on.
    """
    first = Samples.of(way, distances, way.knots[::QUICK])
    if np.any(first.found < wanted):
        return first.nearest(wanted, touched=True)
    samples = Samples.of(way, distances, way.knots)
    left, right = np.arange(len(way.knots) - 1), np.arange(1, len(way.knots))
    closed = []
    while len(left):
        bounds = samples.bounds(left, right, reach)
        open_ = np.any(bounds < wanted, axis=1)
        closed.append((left[~open_], right[~open_]))
        touched = bool(np.any(samples.found < wanted))
        if touched or len(samples.x) + int(open_.sum()) > MOST:
            return samples.nearest(bounds.min(axis=0), touched=touched)
        left, right = left[open_], right[open_]
        if len(left):
            middle = samples.add(0.5 * (samples.x[left] + samples.x[right]))
            left, right = np.concatenate([left, middle]), np.concatenate([middle, right])
    if excess is not None:
        samples.found = samples.found - excess(samples.poses)
    left, right = (np.concatenate(ends) for ends in zip(*closed, strict=True))
    proved = samples.bounds(left, right, reach).min(axis=0)
    return samples.nearest(proved, touched=bool(np.any(samples.found < wanted)))
