"""A convex set of parameters: slabs and second-order cones, with exact line steps.

What is linear in the parameters and bounded in size at each grid angle is convex whatever it is: position
(slabs), |velocity|, |a + g| and the cylinder (balls), tilt (a cone about the vertical).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.trajectories.extremes import ROOM

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Cone:
    """|rows_m p + offset_m| <= 1 + slope_m p for M angles m; slope 0: a ball.

    Attributes:
        name: of the limit.
        rows: (k, M, P). offset: (k, M). slope: (M, P).
    """

    name: str
    rows: Array
    offset: Array
    slope: Array

    def parts(self, points: Array) -> tuple[Array, Array]:
        """u (k, M, K) and reach (M, K) at points (K, P)."""
        k, M, P = self.rows.shape
        u = (self.rows.reshape(k * M, P) @ points.T).reshape(k, M, -1) + self.offset[:, :, None]
        return u, 1.0 + self.slope @ points.T

    def slack(self, point: Array) -> Array:
        """(M,) reach^2 - |u|^2, >= 0 inside (where the reach is positive)."""
        u, reach = self.parts(point[None])
        return np.asarray(reach[:, 0] ** 2 - (u[:, :, 0] ** 2).sum(axis=0))

    def slack_jacobian(self, point: Array) -> Array:
        """(M, P) derivative of `slack`."""
        u, reach = self.parts(point[None])
        inward = 2.0 * reach * self.slope
        return np.asarray(inward - 2.0 * np.einsum("km,kmp->mp", u[:, :, 0], self.rows))

    def reach_along(self, points: Array, directions: Array) -> tuple[Array, Array]:
        """Least and largest multiples (K,) of the directions (K, P) that stay inside, from points inside."""
        u, e = self.parts(points)
        w, slope = self.parts(directions)
        w, slope = w - self.offset[:, :, None], slope - 1.0
        # |u + s w|^2 - (e + s slope)^2 = A s^2 + 2 B s + C <= 0, with C <= 0 at s = 0
        A = (w * w).sum(axis=0) - slope**2
        B = (u * w).sum(axis=0) - e * slope
        C = np.minimum((u * u).sum(axis=0) - e**2, 0.0)
        return -_first_root(A, -B, C).min(axis=0), _first_root(A, B, C).min(axis=0)


def _first_root(A: Array, B: Array, C: Array) -> Array:
    """Smallest s >= 0 with A s^2 + 2 B s + C = 0, C <= 0, without cancellation; infinite if there is none."""
    inside = B * B - A * C
    root = np.sqrt(np.maximum(inside, 0.0))
    ahead = (B > 0.0) & (inside >= 0.0)
    out = np.full(A.shape, np.inf)
    np.divide(root - B, A, out=out, where=~ahead & (A > 0.0))
    np.divide(-C, B + root, out=out, where=ahead)
    return out


@dataclass(frozen=True, eq=False)
class FeasibleSet:
    """All parameters p (P,) with |slabs p - middle| <= 1 and in every cone; bounded and convex.

    Attributes:
        slabs: (m, P). middle: (m,).
        cones: the rest.
        centre: (P,) a point well inside.
    """

    slabs: Array
    middle: Array
    cones: tuple[Cone, ...]
    centre: Array

    @property
    def size(self) -> int:
        """P."""
        return len(self.centre)

    def contains(self, point: Array) -> bool:
        """Whether p (P,) is inside, edges included."""
        if not np.all(np.abs(self.slabs @ point - self.middle) <= 1.0):
            return False
        inside = (
            bool(np.all(cone.slack(point) >= 0.0) and np.all(1.0 + cone.slope @ point >= 0.0))
            for cone in self.cones
        )
        return all(inside)

    def slack(self, point: Array) -> Array:
        """(C,) one number per constraint, >= 0 inside: for a solver."""
        use = self.slabs @ point - self.middle
        return np.concatenate([1.0 - use, 1.0 + use, *(cone.slack(point) for cone in self.cones)])

    def slack_jacobian(self, point: Array) -> Array:
        """(C, P) derivative of `slack`, in closed form."""
        parts = [cone.slack_jacobian(point) for cone in self.cones]
        return np.concatenate([-self.slabs, self.slabs, *parts])

    def chord(self, points: Array, directions: Array) -> tuple[Array, Array]:
        """Exact ends of lines through the set: points + s directions is inside for low <= s <= high.

        Args:
            points: (K, P), inside.
            directions: (K, P), none zero.

        Returns:
            low (K,) <= 0 and high (K,) >= 0.
        """
        use, step = self.slabs @ points.T - self.middle[:, None], self.slabs @ directions.T
        size, leaning = np.abs(step), np.where(step >= 0.0, 1.0, -1.0) * use
        ahead, behind = np.full((2, *size.shape), np.inf)
        with np.errstate(over="ignore"):  # a row that hardly moves ends the line nowhere
            np.divide(np.maximum(1.0 - leaning, 0.0), size, out=ahead, where=size > 0.0)
            np.divide(np.maximum(1.0 + leaning, 0.0), size, out=behind, where=size > 0.0)
        lows, highs = [-behind.min(axis=0, initial=np.inf)], [ahead.min(axis=0, initial=np.inf)]
        for cone in self.cones:
            first, last = cone.reach_along(points, directions)
            lows.append(first)
            highs.append(last)
        return np.max(lows, axis=0), np.min(highs, axis=0)

    def furthest(self, direction: Array) -> float:
        """Largest s with centre + s direction inside."""
        return float(self.chord(self.centre[None], direction[None])[1][0])

    def shrink(self, point: Array) -> Array:
        """The point itself if it is inside, else the last one inside on the way to it from the centre."""
        if self.contains(point):
            return point
        offset = point - self.centre
        inside: Array = self.centre + offset * (ROOM * min(1.0, self.furthest(offset)))
        return inside

    def widths(self) -> Array:
        """(P,) half lengths of the chords through the centre along each parameter: its natural scale."""
        low, high = self.chord(np.tile(self.centre, (self.size, 1)), np.eye(self.size))
        return np.asarray(0.5 * (high - low))
