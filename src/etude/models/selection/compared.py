"""Is a model better than another? The ratio of their errors, paired by segment, with its 95 % interval.

The error of a command in a segment is its root mean square. Its ratio to the other model's has no unit, so
the commands of a segment are averaged as logarithms. Between segments the logarithms are taken as normal:
the interval is Student's t of their mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from etude.types import Array, Index

LEAST_SEGMENTS = 4
"""Fewer decide nothing."""
NARROW, WIDE = 0.6744897501960817, 1.959963984540054
"""Deviations of the 50 % and the 95 % interval of a normal distribution."""
LEAST_COVERED = 0.85
"""Part of the commands that the 95 % interval has to hold. Intervals that are too wide are no reason against
a model: calibration widens them where held-out errors ask for it, and never narrows them."""
Decision = Literal["better", "not better", "not decided"]


@dataclass(frozen=True)
class Compared:
    """Errors of a model over those of another; below 1 it is better.

    Attributes:
        against: what it is compared with, in words.
        segments: how many.
        ratio, lower, upper: geometric mean over segments and commands, and its 95 % interval; NaN where
            there are fewer than two segments.
        by_command: (J,) geometric means over segments.
    """

    against: str
    segments: int
    ratio: float
    lower: float
    upper: float
    by_command: tuple[float, ...]

    @property
    def decision(self) -> Decision:
        if self.segments < LEAST_SEGMENTS:
            return "not decided"
        return "better" if self.upper < 1.0 else "not better"


def compared(against: str, own: Array, other: Array) -> Compared:
    """The comparison of errors (S, J) by segment and command; NaN where a command said nothing."""
    from scipy.stats import t

    tiny = np.finfo(float).tiny
    logs = np.log(np.maximum(own, tiny)) - np.log(np.maximum(other, tiny))
    known = np.isfinite(logs)
    logs = logs[known.any(axis=1)]
    by_command = tuple(_exp(column[np.isfinite(column)]) for column in logs.T)
    means = np.array([row[np.isfinite(row)].mean() for row in logs])
    count = len(means)
    if count < 2:
        return Compared(against, count, _exp(means), np.nan, np.nan, by_command)
    half = float(t.ppf(0.975, count - 1) * means.std(ddof=1) / np.sqrt(count))
    lower, upper = np.exp([means.mean() - half, means.mean() + half]).tolist()
    return Compared(against, count, _exp(means), lower, upper, by_command)


def _exp(logs: Array) -> float:
    """Geometric mean, of logarithms; NaN of none."""
    return float(np.exp(logs.mean())) if len(logs) else float("nan")


def by_segment(error: Array, group: Index, segments: Sequence[int]) -> Array:
    """(S, J) root mean square of errors (n, J) in each segment; NaN where there are none."""
    rows = [np.where(group[:, None] == number, error, np.nan) for number in segments]
    known = [np.isfinite(own).sum(axis=0) for own in rows]
    sums = [np.nansum(own**2, axis=0) for own in rows]
    shape = (len(rows), error.shape[1])
    counts, squares = np.reshape(known, shape), np.reshape(sums, shape)
    return np.asarray(np.sqrt(squares / np.where(counts > 0, counts, np.nan)))


def coverage(error: Array, variance: Array) -> tuple[Array, Array]:
    """(J,) parts of the commands inside their 50 % and 95 % intervals; NaN of none."""
    found = []
    for width in (NARROW, WIDE):
        known = np.isfinite(error) & np.isfinite(variance)
        inside = known & (np.abs(error) <= width * np.sqrt(variance))
        counts = known.sum(axis=0)
        found.append(inside.sum(axis=0) / np.where(counts > 0, counts, np.nan))
    return found[0], found[1]


def uncalibrated(wide: Array) -> list[int]:
    """Commands whose 95 % intervals are too narrow."""
    return [j for j, part in enumerate(wide) if part < LEAST_COVERED]
