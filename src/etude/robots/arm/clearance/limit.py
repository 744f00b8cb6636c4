"""Clearance: a robot keeps away from itself and from what stands around it, at all times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from etude.contracts import Array, Cone, Family, Index, Margins, Motion, Proof, Trajectory
from etude.limits.library import AxisLimit
from etude.limits.ranges import tracked
from etude.robots.arm.clearance.confirmed import excess
from etude.robots.arm.clearance.gaps import CUTOFF, TOLERANCE, Gaps
from etude.robots.arm.clearance.proof import nearest
from etude.robots.arm.clearance.tracked import lost
from etude.robots.arm.clearance.way import Way, way_of

METHOD = "distances of convex hulls at poses, and between them how far joints can carry a point"
KEPT = 256
"""Proofs that are remembered: a certificate asks for each several times."""


@dataclass(frozen=True, eq=False)
class Clearance:
    """A limit of `contracts`: every gap at least as wide as its row of the certificate says.

    Not convex: motions are drawn home until it is proved. Its cones are no proof; they keep a search inside
    the box where nearly all poses are clear, and what is found there may be grown beyond it.

    Attributes:
        gaps: what is looked at.
        names: (k,) of the joints.
        home: (k,) a clear pose.
        margin: m to keep; half of the distance at home where that is less.
        lower, upper: (k,) the box.
        margins: of tracking, by form of motion.
        not_looked_at: sentences, what this limit leaves out.
    """

    gaps: Gaps
    names: tuple[str, ...]
    home: Array
    margin: float
    lower: Array
    upper: Array
    margins: Margins = field(default_factory=dict)
    not_looked_at: tuple[str, ...] = ()
    name: str = "clearance"
    _proofs: dict[str, tuple[Proof, ...]] = field(default_factory=dict, repr=False)

    @cached_property
    def rows(self) -> tuple[tuple[str, str], ...]:
        """Of the certificate: rigid parts, or a part and what stands around."""
        return tuple(dict.fromkeys(gap.row for gap in self.gaps.list))

    @cached_property
    def row_of(self) -> Index:
        """(n,) each gap's row."""
        place = {row: i for i, row in enumerate(self.rows)}
        return np.array([place[gap.row] for gap in self.gaps.list], dtype=np.int64)

    @cached_property
    def kept(self) -> Array:
        """(r,) m that each row keeps."""
        at_home = self._by_row(self.gaps.of_poses(self.home[None]))[0]
        return np.asarray(np.minimum(self.margin, 0.5 * at_home))

    def _by_row(self, distances: Array) -> Array:
        """(T, r) the least of each row, from (T, n)."""
        found = np.full((len(self.rows), len(distances)), np.inf)
        np.minimum.at(found, self.row_of, distances.T)
        return np.asarray(found.T)

    def cones(self, family: Family) -> Sequence[Cone]:
        """The box, for the search."""
        return AxisLimit("box", 0, self.names, self.lower, self.upper).cones(family)

    def penalty(self, motion: Motion) -> tuple[float, Array]:
        """None that pushes: a search that starts in collision stays there, and the way home gets it out."""
        return 0.0, np.zeros_like(motion.orders)

    def prove(self, piece: Trajectory) -> Sequence[Proof]:
        """One row for each pair of rigid parts, and for each part and what stands around."""
        key = piece.to_json()
        if key not in self._proofs:
            if len(self._proofs) >= KEPT:
                self._proofs.clear()
            error, confidence = tracked(0.0, self.margins, piece.form, 0, list(range(len(self.names))))
            self._proofs[key] = self._rows(way_of(piece), error, float(confidence.min()))
        return self._proofs[key]

    def distances(self, poses: Array, error: Array) -> Array:
        """(T, n) m that no gap is less at poses (T, k), nor anywhere within the error (k,) of them."""
        found = self.gaps.of_poses(poses) - TOLERANCE
        if not error.any():
            return found
        return found - lost(self.gaps, poses, found, error, self.kept[self.row_of])

    def _rows(self, way: Way, error: Array, confidence: float) -> tuple[Proof, ...]:
        """The certificate's rows; of a motion that is refused, what samples show."""
        wanted = self.kept[self.row_of]
        found = nearest(
            way,
            lambda poses: self.distances(poses, error),
            self.gaps.reach,
            wanted,
            lambda poses: excess(self.gaps, poses),
        )
        status: Literal["proved", "sampled"] = "sampled" if found.touched else "proved"
        times, poses = way.time(found.x), way.at(found.x)[0]
        rows = []
        for i, (row, least) in enumerate(zip(self.rows, self.kept.tolist(), strict=True)):
            own = np.flatnonzero(self.row_of == i)
            worst = own[np.argmin(found.seen[own])]
            near = found.seen[worst] < CUTOFF - 2.0 * TOLERANCE
            where = f"{self.gaps.list[worst].text} at {times[worst]:.3g} s" if near else ""
            proved = float(found.proved[own].min())
            taken = self._taken(poses[worst], worst, error)
            limit = least, np.inf, proved, CUTOFF
            rows.append(Proof(" and ".join(row), self.name, *limit, METHOD, status, taken, confidence, where))
        return tuple(rows)

    def _taken(self, pose: Array, gap: int, error: Array) -> float:
        """m of a gap that tracking may take at a pose (k,)."""
        if not error.any():
            return 0.0
        planned, kept = (self.distances(pose[None], e)[0, gap] for e in (0.0 * error, error))
        return float(planned - kept)

    def of_motion(self, motion: Motion) -> Array:
        """(T, r) m, the least distance of each row, at most `CUTOFF`."""
        return self._by_row(self.gaps.of_poses(motion.orders[0]))
