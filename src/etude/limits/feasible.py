"""FeasibleSet: the parameters whose motions keep every limit at all times, block by block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from etude.errors import UnsafeTrajectoryError
from etude.limits.blocks import Block
from etude.protocols import Family, Limit
from etude.trajectories.extremes import ROOM
from etude.types import Array, Cone, Index

REFINED = 3
"""Steps of least squares by normal equations, each of which takes the rounding of the last one back."""


@dataclass(frozen=True, eq=False)
class FeasibleSet:
    """All parameters p (P,) inside every cone of the limits; bounded and convex.

    Parameters that no cone couples are in blocks of their own (joints alone, the axes of a speed together):
    the set is the product of its blocks, and each is drawn back, enlarged and sampled by itself.

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
            limits: those without cones take no part.
            family: of one base frequency.
            home: (k,) a pose inside every limit.

        Raises:
            UnsafeTrajectoryError: limits that leave no room, a home or a family's fixed centre outside them,
                or a parameter that nothing bounds.
        """
        check_room(limits, family)
        centre = still_at(family, home)
        cones = [cone for limit in limits for cone in limit.cones(family)]
        _check_centre(cones, family, centre)
        blocks = [Block.of(members, own, centre) for members, own in _coupled(cones, family.size)]
        return cls(tuple(blocks), centre)

    def about(self, centre: Array) -> FeasibleSet:
        """The same set seen from another point (P,) well inside, towards which it is then drawn."""
        return FeasibleSet(tuple(block.about(centre[block.members]) for block in self.blocks), centre)

    @property
    def size(self) -> int:
        """P."""
        return len(self.centre)

    @cached_property
    def block_of(self) -> Index:
        """(P,) place of each parameter's block."""
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
        """Smooth upper bounds (B,) of `gauge`, and gradient (P,): of its own block's in each parameter."""
        values, gradient = np.zeros(len(self.blocks)), np.zeros(self.size)
        for b, block in enumerate(self.blocks):
            values[b], gradient[block.members] = block.smooth_gauge(p[block.members])
        return values, gradient

    def chords(self, points: Array, directions: Array) -> tuple[Array, Array]:
        """Ends (K, B) of lines (K, P) through each block by itself, from points inside; see `Block.chord`."""
        parts = [block.chord(points[:, block.members], directions[:, block.members]) for block in self.blocks]
        lows, highs = (np.stack(side, axis=1) for side in zip(*parts, strict=True))
        return lows, highs

    def chord(self, points: Array, directions: Array) -> tuple[Array, Array]:
        """Exact ends (K,) of lines through the set: points + s directions (K, P), low <= s <= high."""
        lows, highs = self.chords(points, directions)
        return lows.max(axis=1), highs.min(axis=1)

    def shrink(self, p: Array) -> Array:
        """The point with each block that is outside drawn towards the centre, just inside."""
        out = p.copy()
        for block in self.blocks:
            own = p[block.members]
            if not block.contains(own):
                out[block.members] = block.centre + (own - block.centre) * (ROOM / max(block.gauge(own), 1.0))
        return out

    def enlarge(self, p: Array) -> Array:
        """The point with each block on the edge, on its way from the centre; blocks in the centre stay."""
        use = self.gauge(p)
        factor = np.divide(ROOM, use, out=np.ones_like(use), where=use > 0.0)
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
    """UnsafeTrajectoryError if some limit leaves no room for any motion, naming the axis and the limit."""
    form = family.trajectory(np.zeros(family.size)).form
    for limit in limits:
        check: Any = getattr(limit, "check_room", None)
        if check is not None:
            check(form)


def still_at(family: Family, pose: Array) -> Array:
    """(P,) the member that stands still at a pose (k,); the nearest if coordinates are fixed elsewhere."""
    rows, offset, _ = family.rows(0, 1)
    table, wanted = rows.reshape(-1, family.size), (np.asarray(pose)[:, None] - offset).ravel()
    gram, p = table.T @ table, np.zeros(family.size)
    for _ in range(REFINED):
        p = p + np.linalg.lstsq(gram, table.T @ (wanted - table @ p), rcond=None)[0]
    scale = np.abs(p).max(initial=0.0)
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
            f"motions about {text} have no room within the limit of {cone.name}",
            where=cone.name,
            next_step="Move the middle of the motions, or widen the limit.",
        )


def _coupled(cones: Sequence[Cone], size: int) -> list[tuple[Index, list[Cone]]]:
    """Groups of parameters that cones couple, in order of their first, each with its cones."""
    touched = [_touched(cone) for cone in cones]
    group = np.arange(size)
    for mask in touched:
        if mask.any():
            group[np.isin(group, group[mask])] = group[mask].min()
    out = []
    for first in dict.fromkeys(group.tolist()):
        own = group == first
        inside = [cone for cone, mask in zip(cones, touched, strict=True) if np.any(mask & own)]
        if not inside:
            raise UnsafeTrajectoryError(
                f"no limit bounds parameter {first} of the family",
                next_step="Give position and velocity limits for every axis.",
            )
        out.append((np.flatnonzero(own).astype(np.int64), inside))
    return out


def _touched(cone: Cone) -> NDArray[np.bool_]:
    """(P,) parameters that a cone depends on."""
    rows: NDArray[np.bool_] = np.any(cone.rows != 0.0, axis=(0, 1))
    return rows if cone.slope is None else rows | np.any(cone.slope != 0.0, axis=0)
