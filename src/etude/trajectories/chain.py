"""Chains: several segments in one recording, with links between them, an approach and a return."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from etude.errors import UsageError
from etude.protocols import Trajectory
from etude.types import Array, Motion

if TYPE_CHECKING:
    from etude._runtime.pictures import Picture

JOINED = 1e-9
"""Largest step between two parts, in position (rad, m), velocity and acceleration."""
LABELS = ("segment", "link", "approach", "return", "take-off", "landing", "lead-in", "lead-out")
APPROACHES = (frozenset({"approach", "take-off", "lead-in"}), frozenset({"return", "landing", "lead-out"}))
"""Labels of chains without a segment: several moves to a motion, or back from it."""


Part = tuple[str, Trajectory]
"""Purpose of a part, one of `LABELS`, and its motion."""


@dataclass(frozen=True, eq=False)
class Chain:
    """Sequence of parts, continuous in position, velocity and acceleration; limits of arms also require rest.

    Attributes:
        parts: segments, which contain the training data, and links between them.

    Raises:
        UsageError: fewer than two parts, no segment (except in an approach or return), an unknown label, or
            parts that are chains themselves, have other axes, or do not meet.
    """

    parts: tuple[Part, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple((str(label), part) for label, part in self.parts))
        labels = [label for label, _ in self.parts]
        is_approach = any(set(labels) <= allowed for allowed in APPROACHES)
        if len(labels) < 2 or not ("segment" in labels or is_approach) or not set(labels) <= set(LABELS):
            raise UsageError(f"a chain has two parts or more, each one of {', '.join(LABELS)}, not {labels}")
        if any(part.form == self.form for _, part in self.parts):
            raise UsageError("a part of a chain cannot be a chain itself")
        ends = [part.motion(np.array([0.0, part.duration])).orders for _, part in self.parts]
        if len({orders.shape[2] for orders in ends}) > 1:
            raise UsageError("the parts of a chain move different numbers of axes")
        for number, (before, after) in enumerate(pairwise(ends), start=1):
            step = np.abs(after[0, 0] - before[0, 1]).max()
            jump = np.abs(after[1:, 0] - before[1:, 1]).max()
            if not max(step, jump) <= JOINED:
                raise UsageError(
                    f"parts {number} and {number + 1} of the chain do not meet: "
                    f"a step of {step:.3g}, one of {jump:.3g} in speed or acceleration"
                )

    @property
    def form(self) -> str:
        """Form in its file; tracking margins depend on the forms of its parts."""
        return "chain"

    @property
    def duration(self) -> float:
        """Of all parts, s."""
        start, _, last = self.pieces()[-1]
        return start + last.duration

    def pieces(self) -> Sequence[tuple[float, str, Trajectory]]:
        """The parts, each with the time at which it starts."""
        starts = accumulate((part.duration for _, part in self.parts[:-1]), initial=0.0)
        return tuple((start, label, part) for start, (label, part) in zip(starts, self.parts, strict=True))

    def motion(self, t: Array, orders: int = 3) -> Motion:
        """Position and exact derivatives at times t (T,) s; at rest outside [0, duration].

        Raises:
            UsageError: more orders than the links have (four).
        """
        t, pieces = np.asarray(t, dtype=float), self.pieces()
        starts = np.array([start for start, _, _ in pieces])
        place = np.maximum(np.searchsorted(starts, t, side="right") - 1, 0)
        out: Array | None = None
        for number, (start, _, part) in enumerate(pieces):
            local = t[place == number] - start
            # the difference of summed durations equals this one only up to rounding
            local = np.where(np.abs(local - part.duration) <= JOINED, part.duration, local)
            values = part.motion(local, orders).orders
            if out is None:
                out = np.zeros((orders, len(t), values.shape[2]))
            out[:, place == number] = values
        assert out is not None
        return Motion(t, out)

    def bound(self, order: int, degree: int) -> tuple[Array, Array, float]:  # noqa: ARG002
        """Raise UsageError: no chain is proved as a whole."""
        raise UsageError("a chain is proved piece by piece", next_step="Ask its pieces.")

    def slowed(self, factor: float) -> Chain:
        """The same path in `factor` times the time."""
        return Chain(tuple((label, part.slowed(factor)) for label, part in self.parts))

    def plot(self, path: str | Path | None = None) -> Picture:
        """Motion over time: shown by a notebook, and saved as SVG if there is a path."""
        from etude._runtime.pictures import picture_of

        return picture_of("trajectory", self, path)

    def to_json(self) -> str:
        """The exact chain as JSON text; every float of every part reads back to the same bits."""
        parts = [[label, json.loads(part.to_json())] for label, part in self.parts]
        return json.dumps({"form": self.form, "parts": parts}, indent=1) + "\n"


def chained(segments: Sequence[Trajectory], links: Sequence[Sequence[Trajectory]]) -> Trajectory:
    """The segments, with one or more links between two of them; of a single segment, itself.

    A segment may be a chain: one with its lead-in and lead-out.
    """
    if len(segments) == 1:
        return segments[0]
    parts = _pieces(segments[0])
    for between, segment in zip(links, segments[1:], strict=True):
        parts += [*(("link", link) for link in between), *_pieces(segment)]
    return Chain(tuple(parts))


def _pieces(segment: Trajectory) -> list[Part]:
    return [(label, piece) for _, label, piece in segment.pieces()]


def segment_starts(trajectory: Trajectory) -> list[float]:
    """Start time of each segment, s, including its lead-in; a link belongs to the segment before it."""
    pieces = trajectory.pieces()
    return [
        pieces[i - 1][0] if i and pieces[i - 1][1] == "lead-in" else start
        for i, (start, label, _) in enumerate(pieces)
        if label == "segment"
    ]
