"""Ratios over paired seeds: their geometric mean and its interval."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Paired:
    """A geometric mean of ratios over paired seeds.

    Attributes:
        ratio: the mean. low, high: ends of its 95 % t-interval; NaN with a single seed. count: seeds.
    """

    ratio: float
    low: float
    high: float
    count: int

    @property
    def words(self) -> str:
        """The interval, for people."""
        return f"95 %: {self.low:.2f} .. {self.high:.2f}, {self.count} seeds"


def paired(numerators: Sequence[float], denominators: Sequence[float]) -> Paired:
    """Numerator over denominator, seed by seed."""
    from scipy.stats import t

    logs = np.log(np.asarray(numerators) / np.asarray(denominators))
    mean, count = float(logs.mean()), len(logs)
    half = math.nan
    if count > 1:
        half = float(t.ppf(0.975, count - 1) * logs.std(ddof=1) / math.sqrt(count))
    return Paired(math.exp(mean), math.exp(mean - half), math.exp(mean + half), count)
