"""FeasibleSet: the parameters whose motions keep every limit at all times, as blocks of convex sets.

Every bound on the size of something linear in the parameters is convex: position (slabs), |velocity|,
|a + g| and the cylinder (balls), tilt (a cone about the vertical).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from etude.abilities import SupportsRoomCheck
from etude.errors import UnsafeTrajectoryError
from etude.protocols import Family, Limit
from etude.trajectories.extremes import USABLE_PART
from etude.types import Array, Cone, Index

REFINED = 3
"""Steps of least squares by normal equations; each step corrects the rounding of the one before."""


SHARPNESS = 48
"""Exponent of the p-norms of `smooth_gauge`."""


@dataclass(frozen=True, eq=False)
class Ball:
    """|rows_m p + offset_m| <= 1 + slope_m p at M instants: a `Cone`, relative to a centre inside it.

    Attributes:
        rows: (c, M, n). offset: (c, M). slope: (M, n).
        centre: (n,) inside.
    """

    rows: Array
    offset: Array
    slope: Array
    centre: Array

    @cached_property
    def start(self) -> tuple[Array, Array, Array]:
        """At the centre: u (c, M), reach (M,) and reach^2 - |u|^2 (M,)."""
        u, reach = self.parts(self.centre[None])
        u, reach = u[:, :, 0], reach[:, 0]
        return u, reach, reach**2 - (u * u).sum(axis=0)

    def parts(self, points: Array) -> tuple[Array, Array]:
        """u (c, M, K) and reach (M, K) at points (K, n)."""
        c, M, n = self.rows.shape
        u = (self.rows.reshape(c * M, n) @ points.T).reshape(c, M, -1) + self.offset[:, :, None]
        return u, 1.0 + self.slope @ points.T

    def contains(self, point: Array) -> bool:
        """Whether p (n,) is inside, edges included."""
        u, reach = self.parts(point[None])
        return bool(np.all(reach >= 0.0) and np.all(reach**2 - (u**2).sum(axis=0) >= 0.0))

    def uses(self, step: Array) -> tuple[Array, Array, Array, Array]:
        """Gauge (M,) of centre + step (n,) at each instant, and what its gradient needs.

        The least g >= 0 for which centre + step/g is inside: the larger root of
        (e^2 - |u|^2) g^2 + 2 (e s - u.w) g + s^2 - |w|^2, u and e of the centre, w and s of the step.

        Returns:
            g (M,), root of the discriminant (M,), w (c, M), s (M,).
        """
        u, e, A = self.start
        w, s = self.rows @ step, self.slope @ step
        B = e * s - (u * w).sum(axis=0)
        root = np.sqrt(np.maximum(B * B - A * (s * s - (w * w).sum(axis=0)), 0.0))
        return np.maximum((root - B) / A, 0.0), root, w, s

    def pulled(self, weights: Array, g: Array, root: Array, w: Array, s: Array) -> Array:
        """(n,) sum of weights (M,) times the gradients of `uses`."""
        u, e, _ = self.start
        share = np.divide(weights, root, out=np.zeros_like(root), where=(root > 0.0) & (g > 0.0))
        inward = np.einsum("cm,cmn->n", share * (g * u + w), self.rows)
        return np.asarray(inward - (share * (g * e + s)) @ self.slope)

    def reach_along(self, points: Array, directions: Array) -> tuple[Array, Array]:
        """Least and largest multiples (K,) of the directions (K, n) that stay inside, from points inside."""
        u, e = self.parts(points)
        w, slope = self.parts(directions)
        w, slope = w - self.offset[:, :, None], slope - 1.0
        # |u + s w|^2 - (e + s slope)^2 = A s^2 + 2 B s + C <= 0, with C <= 0 at s = 0
        A = (w * w).sum(axis=0) - slope**2
        B = (u * w).sum(axis=0) - e * slope
        C = np.minimum((u * u).sum(axis=0) - e**2, 0.0)
        inside = B * B - A * C  # of both roots
        root = np.sqrt(np.maximum(inside, 0.0))
        behind, ahead = (_first_root(A, b, C, inside, root) for b in (-B, B))
        return -behind.min(axis=0), ahead.min(axis=0)


def _first_root(A: Array, B: Array, C: Array, inside: Array, root: Array) -> Array:
    """Smallest s >= 0 with A s^2 + 2 B s + C = 0, C <= 0, without cancellation; infinite if there is none.

    inside: B^2 - A C. root: of that, 0 where it is negative.
    """
    ahead = (B > 0.0) & (inside >= 0.0)
    out = np.full(A.shape, np.inf)
    np.divide(root - B, A, out=out, where=~ahead & (A > 0.0))
    np.divide(-C, B + root, out=out, where=ahead)
    return out


@dataclass(frozen=True, eq=False)
class Block:
    """Parameters that cones couple with one another and with no others.

    Attributes:
        members: (n,) places of its parameters.
        slabs: (m, n) and middle: (m,): |slabs p - middle| <= 1.
        balls: the other cones.
        centre: (n,) a point inside.
        still: (s,) indices, within the block, of parameters that only shift the motion: their rows are the
            same at every instant.
    """

    members: Index
    slabs: Array
    middle: Array
    balls: tuple[Ball, ...]
    centre: Array
    still: Index

    @classmethod
    def of(cls, members: Index, cones: Sequence[Cone], centre: Array) -> Block:
        """The block of these parameters, from the cones that couple them."""
        block_centre = centre[members]
        flat = [cone for cone in cones if cone.slope is None and len(cone.rows) == 1]
        rows = [cone.rows[0][:, members] for cone in flat]
        middle = [-cone.offset[0] for cone in flat]
        balls = [
            Ball(cone.rows[:, :, members], cone.offset, _slope(cone)[:, members], block_centre)
            for cone in cones
            if cone.slope is not None or len(cone.rows) > 1
        ]
        tables = [*rows, *(ball.slope for ball in balls), *(part for ball in balls for part in ball.rows)]
        still = np.flatnonzero([all(_constant(table[:, i]) for table in tables) for i in range(len(members))])
        empty = np.zeros((0, len(members)))
        return cls(
            members,
            np.concatenate([empty, *rows]),
            np.concatenate([np.zeros(0), *middle]),
            tuple(balls),
            block_centre,
            still.astype(np.int64),
        )

    def about(self, centre: Array) -> Block:
        """The same block about another centre (n,) inside."""
        return replace(self, centre=centre, balls=tuple(replace(ball, centre=centre) for ball in self.balls))

    @cached_property
    def _start(self) -> Array:
        """(m,) signed use of the slabs at the centre."""
        return np.asarray(self.slabs @ self.centre - self.middle)

    def contains(self, point: Array) -> bool:
        """Whether p (n,) is inside, edges included."""
        flat = bool(np.all(np.abs(self.slabs @ point - self.middle) <= 1.0))
        return flat and all(ball.contains(point) for ball in self.balls)

    def _flat_uses(self, step: Array) -> tuple[Array, Array]:
        """Gauge (m,) of the slabs at centre + step, and its derivative in each row's own step."""
        along = self.slabs @ step
        slope = np.where(along >= 0.0, 1.0, -1.0)
        slope = slope / (1.0 - slope * self._start)
        return along * slope, slope

    def gauge(self, point: Array) -> float:
        """Least g for which centre + (p - centre)/g is inside; <= 1 means inside."""
        step = point - self.centre
        uses = [self._flat_uses(step)[0], *(ball.uses(step)[0] for ball in self.balls)]
        return max(float(use.max(initial=0.0)) for use in uses)

    def smooth_gauge(self, point: Array) -> tuple[float, Array]:
        """A smooth upper bound of `gauge`, a few per cent above it, and its gradient (n,).

        It has p-norms in place of maxima. Optima, and starts that were scaled to the limits, touch several
        limits at once. There the exact gauge has corners that stop a quasi-Newton search.
        """
        step = point - self.centre
        flat, slope = self._flat_uses(step)
        balls = [ball.uses(step) for ball in self.balls]
        value, weights = _norm([flat, *(use[0] for use in balls)])
        gradient = (weights[0] * slope) @ self.slabs
        for ball, use, weight in zip(self.balls, balls, weights[1:], strict=True):
            gradient = gradient + ball.pulled(weight, *use)
        return value, gradient

    def chord(self, points: Array, directions: Array) -> tuple[Array, Array]:
        """Exact ends of lines through the block: points + s directions is inside for low <= s <= high.

        Args:
            points: (K, n), inside.
            directions: (K, n); a zero direction has infinite ends.

        Returns:
            low (K,) <= 0 and high (K,) >= 0.
        """
        use, step = self.slabs @ points.T - self.middle[:, None], self.slabs @ directions.T
        bound, changes = np.copysign(1.0, step), step != 0.0  # the side of the slab that lies ahead
        ahead, behind = np.full((2, *step.shape), np.inf)
        with np.errstate(over="ignore"):  # a row that hardly changes does not bound the line
            np.divide(bound - use, step, out=ahead, where=changes)
            np.divide(bound + use, step, out=behind, where=changes)
        # a point that rounding put outside is on the edge: its line ends there
        lows = [-np.maximum(behind.min(axis=0, initial=np.inf), 0.0)]
        highs = [np.maximum(ahead.min(axis=0, initial=np.inf), 0.0)]
        for ball in self.balls:
            first, last = ball.reach_along(points, directions)
            lows.append(first)
            highs.append(last)
        return np.max(lows, axis=0), np.min(highs, axis=0)

    def ellipsoid(self) -> Array:
        """(n, n) T: the ellipsoid centre + T z, |z| <= 1, holds the block; the rows' mean square is |z|^2."""
        tables = [self.slabs, *(part for ball in self.balls for part in (*ball.rows, ball.slope))]
        rows = np.concatenate([table[np.any(table != 0.0, axis=1)] for table in tables])
        values, vectors = np.linalg.eigh(rows.T @ rows / len(rows))
        # directions in which no row changes are rounding: widths are cut at 1e7 times the narrowest one
        return np.asarray(vectors / np.sqrt(np.maximum(values, 1e-14 * values.max())))


def _slope(cone: Cone) -> Array:
    return np.zeros(cone.rows.shape[1:]) if cone.slope is None else cone.slope


def _constant(column: Array) -> bool:
    """Whether all numbers are equal up to rounding."""
    # some thousand roundings of a float64
    return bool(np.ptp(column) <= 1e-12 * np.abs(column).max(initial=0.0))


def _norm(uses: list[Array]) -> tuple[float, list[Array]]:
    """p-norm over everything, never below the largest use (>= 0), and its derivative in each use."""
    peak = max([float(use.max(initial=0.0)) for use in uses] + [float(np.finfo(float).tiny)])
    total = sum(float(_power(use / peak, SHARPNESS).sum()) for use in uses)
    norm = peak * max(total, 1.0) ** (1.0 / SHARPNESS)  # less than 1 only at the centre, where all are 0
    return norm, [_power(use / norm, SHARPNESS - 1) for use in uses]


def _power(base: Array, exponent: int) -> Array:
    """base^exponent by squaring, several times faster than `**` for a whole exponent >= 1."""
    out = np.ones_like(base)
    while exponent:
        if exponent & 1:
            out = out * base
        base, exponent = base * base, exponent >> 1
    return out


@dataclass(frozen=True, eq=False)
class FeasibleSet:
    """All parameters p (P,) inside every cone of the limits; bounded and convex.

    Parameters that no cone couples are in separate blocks: one for each joint, but one for all axes of a
    speed. The set is the product of its blocks; each is shrunk, enlarged and sampled separately.

    Attributes:
        blocks: B of them.
        centre: (P,) the motion that stands still at home, well inside.
    """

    blocks: tuple[Block, ...]
    centre: Array

    @classmethod
    def of(cls, limits: Sequence[Limit], family: Family, home: Array) -> FeasibleSet:
        """The set of the family's members inside the limits.

        Args:
            limits: limits without cones have no effect.
            family: of one base frequency.
            home: (k,) a pose inside every limit.

        Raises:
            UnsafeTrajectoryError: the limits leave no room, exclude home or the family's fixed centre, or
                leave a parameter unbounded.
        """
        check_room(limits, family)
        centre = still_at(family, home)
        cones = [cone for limit in limits for cone in limit.cones(family)]
        _check_centre(cones, family, centre)
        blocks = [Block.of(members, coupled, centre) for members, coupled in _coupled(cones, family.size)]
        return cls(tuple(blocks), centre)

    def about(self, centre: Array) -> FeasibleSet:
        """The same set about another centre (P,) well inside, towards which points are then shrunk."""
        return FeasibleSet(tuple(block.about(centre[block.members]) for block in self.blocks), centre)

    @property
    def size(self) -> int:
        """P."""
        return len(self.centre)

    @cached_property
    def block_of(self) -> Index:
        """(P,) index of each parameter's block."""
        out = np.zeros(self.size, dtype=np.int64)
        for b, block in enumerate(self.blocks):
            out[block.members] = b
        return out

    def contains(self, p: Array) -> bool:
        """Whether p (P,) is inside, edges included."""
        return all(block.contains(p[block.members]) for block in self.blocks)

    def gauge(self, p: Array) -> Array:
        """(B,) least g for which centre + (p - centre)/g is inside that block; <= 1 means inside."""
        return np.array([block.gauge(p[block.members]) for block in self.blocks])

    def smooth_gauge(self, p: Array) -> tuple[Array, Array]:
        """Smooth upper bounds (B,) of `gauge`, and (P,) derivatives, each of the parameter's own block."""
        values, gradient = np.zeros(len(self.blocks)), np.zeros(self.size)
        for b, block in enumerate(self.blocks):
            values[b], gradient[block.members] = block.smooth_gauge(p[block.members])
        return values, gradient

    def chords(self, points: Array, directions: Array) -> tuple[Array, Array]:
        """Ends (K, B) of lines (K, P) through each separate block, from points inside; see `Block.chord`."""
        parts = [block.chord(points[:, block.members], directions[:, block.members]) for block in self.blocks]
        lows, highs = (np.stack(side, axis=1) for side in zip(*parts, strict=True))
        return lows, highs

    def chord(self, points: Array, directions: Array) -> tuple[Array, Array]:
        """Exact ends (K,) of lines through the set: points + s directions (K, P), low <= s <= high."""
        lows, highs = self.chords(points, directions)
        return lows.max(axis=1), highs.min(axis=1)

    def shrink(self, p: Array) -> Array:
        """The point with each block that lies outside moved towards the centre until just inside."""
        out = p.copy()
        for block in self.blocks:
            block_point = p[block.members]
            if not block.contains(block_point):
                out[block.members] = block.centre + (block_point - block.centre) * (
                    USABLE_PART / max(block.gauge(block_point), 1.0)
                )
        return out

    def enlarge(self, p: Array) -> Array:
        """The point with each block moved away from the centre to the edge; blocks at the centre stay."""
        use = self.gauge(p)
        factor = np.divide(USABLE_PART, use, out=np.ones_like(use), where=use > 0.0)
        return np.asarray(self.centre + (p - self.centre) * factor[self.block_of])

    def widths(self) -> Array:
        """(P,) half lengths of the chords through the centre along each parameter: its natural scale."""
        low, high = self.chord(np.tile(self.centre, (self.size, 1)), np.eye(self.size))
        return np.asarray(0.5 * (high - low))

    def ellipsoid(self) -> Array:
        """(P, P) T of variables z: p = centre + T z, with |z_block| <= 1 around each block; for searches."""
        out = np.zeros((self.size, self.size))
        for block in self.blocks:
            out[np.ix_(block.members, block.members)] = block.ellipsoid()
        return out


def check_room(limits: Sequence[Limit], family: Family) -> None:
    """Raise UnsafeTrajectoryError, with the axis and the limit, if a limit leaves no room for motion."""
    form = family.trajectory(np.zeros(family.size)).form
    for limit in limits:
        if isinstance(limit, SupportsRoomCheck):
            limit.check_room(form)


def still_at(family: Family, pose: Array) -> Array:
    """(P,) the member at rest at a pose (k,); the nearest one if some coordinates are fixed elsewhere."""
    rows, offset, _ = family.rows(0, 1)
    table, target = rows.reshape(-1, family.size), (np.asarray(pose)[:, None] - offset).ravel()
    gram, p = table.T @ table, np.zeros(family.size)
    for _ in range(REFINED):
        p = p + np.linalg.lstsq(gram, table.T @ (target - table @ p), rcond=None)[0]
    scale = np.abs(p).max(initial=0.0)
    # parameters that cancel leave a rounding error: set it to zero
    return np.where(np.abs(p) > 1e-14 * scale, p, 0.0)


def _check_centre(cones: Sequence[Cone], family: Family, centre: Array) -> None:
    for cone in cones:
        u = np.tensordot(cone.rows, centre, 1) + cone.offset
        reach = 1.0 if cone.slope is None else 1.0 + cone.slope @ centre
        if np.all(np.sqrt((u * u).sum(axis=0)) < reach):
            continue
        place = family.motion(centre, np.zeros(1), 1).orders[0, 0]
        text = ", ".join(f"{x:g}" for x in place)
        raise UnsafeTrajectoryError(
            f"motions about {text} have no room inside the limit of {cone.name}",
            where=cone.name,
            next_step="Move the middle of the motions, or enlarge the limit.",
        )


def _coupled(cones: Sequence[Cone], size: int) -> list[tuple[Index, list[Cone]]]:
    """Groups of parameters that cones couple, each with its cones, ordered by their first parameter."""
    touched = [_coupled_mask(cone) for cone in cones]
    group = np.arange(size)
    for mask in touched:
        if mask.any():
            group[np.isin(group, group[mask])] = group[mask].min()
    out = []
    for first in dict.fromkeys(group.tolist()):
        is_member = group == first
        inside = [cone for cone, mask in zip(cones, touched, strict=True) if np.any(mask & is_member)]
        if not inside:
            raise UnsafeTrajectoryError(
                f"no limit bounds parameter {first} of the family",
                next_step="Give position and velocity limits for every axis.",
            )
        out.append((np.flatnonzero(is_member).astype(np.int64), inside))
    return out


def _coupled_mask(cone: Cone) -> NDArray[np.bool_]:
    """(P,) parameters that a cone depends on."""
    rows: NDArray[np.bool_] = np.any(cone.rows != 0.0, axis=(0, 1))
    return rows if cone.slope is None else rows | np.any(cone.slope != 0.0, axis=0)
