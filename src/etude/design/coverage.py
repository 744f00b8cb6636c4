"""Coverage: which part of where a robot can be its motions have visited, coordinate by coordinate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude.protocols import Trajectory
from etude.types import Array, Mask, Reachable

BINS = 20
"""Of the range between a coordinate's extreme clear poses."""
LEAST = 0.005
"""Part of the time that a bin needs to count as visited: a motion that only turns round there shows little.
"""
INSTANTS = 512
"""At which a segment is looked at, for the report."""
FEW = 96
"""The same of a candidate."""


@dataclass(frozen=True, eq=False)
class Visited:
    """The time that segments spend in each bin of each coordinate; links do not count.

    Attributes:
        lower, upper: (k,) ends between which clear poses lie.
        seconds: (k, BINS).
        total: s of all segments.
    """

    lower: Array
    upper: Array
    seconds: Array
    total: float = 0.0

    @classmethod
    def nothing(cls, reach: Reachable) -> Visited:
        """Before any motion."""
        lower, upper = reach.clear
        return cls(lower, upper, np.zeros((len(lower), BINS)))

    def adding(self, trajectories: Sequence[Trajectory]) -> Visited:
        """With the segments of these."""
        pieces = [p for own in trajectories for _, label, p in own.pieces() if label == "segment"]
        found = self
        for piece in pieces:
            t = piece.duration * (np.arange(INSTANTS) + 0.5) / INSTANTS
            found = found.adding_poses(piece.motion(t, 1).orders[0], piece.duration)
        return found

    def adding_poses(self, poses: Array, duration: float) -> Visited:
        """With poses (T, k), spread evenly over a time in s."""
        each = duration / max(len(poses), 1)
        return replace(self, seconds=self.seconds + each * self.counts(poses), total=self.total + duration)

    def counts(self, poses: Array) -> Array:
        """(k, BINS) poses (T, k) in each bin."""
        place = np.floor(BINS * (poses - self.lower) / np.maximum(self.upper - self.lower, 1e-12))
        place = np.where(poses == self.upper, BINS - 1, place)
        inside = (place >= 0) & (place < BINS)
        found = np.zeros((poses.shape[1], BINS))
        coordinate = np.broadcast_to(np.arange(poses.shape[1]), poses.shape)
        np.add.at(found, (coordinate[inside], place[inside].astype(np.int64)), 1.0)
        return found

    def bins(self, total: float | None = None) -> Mask:
        """(k, BINS) which were visited, of a total time in s (None: of what there was)."""
        whole = self.total if total is None else total
        return np.asarray((self.seconds > 0.0) & (self.seconds >= LEAST * whole))

    def share(self, total: float | None = None) -> Array:
        """(k,) part of each coordinate's bins that was visited."""
        return np.asarray(self.bins(total).mean(axis=1))
