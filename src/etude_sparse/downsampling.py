"""Downsampling: the exact process on a thinned data set (thesis 6.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError
from etude.models.gp.exact import ExactGP, ExactPosterior, checked_data
from etude.types import Array


@dataclass(frozen=True)
class DownsampledGP:
    """Exact regression on every `every`-th point, or on `count` points evenly spread (`protocols.Regressor`).

    Choose it first: samples of a smooth motion repeat their neighbours, so thinning loses little. The
    selection does not depend on the outputs, so variances stay those of an exact process on the selected
    points. With `every` it forgets nothing but grows with every trajectory; with `count` it is diluted. Where
    that hurts, a dictionary keeps the informative points instead.

    Attributes:
        gp: the process.
        every: keep each so-manieth point (12 in the thesis: 100 Hz to 8.3 Hz); None to go by count.
        count: keep at most that many; None to go by `every`.
        offset: with `every`, position of the first point kept.
    """

    gp: ExactGP
    every: int | None = 12
    count: int | None = None
    offset: int = 0

    def __post_init__(self) -> None:
        if (self.every is None) == (self.count is None):
            raise UsageError("downsampling goes by every or by count: give one and set the other to None")
        if (self.every or self.count or 0) < 1:
            raise UsageError(f"every and count must be at least 1, got {self.every or self.count}")
        if not 0 <= self.offset < (self.every or 1):
            raise UsageError(f"offset must be at least 0 and below every, got {self.offset}")

    def keep(self, n: int) -> NDArray[np.int64]:
        """Positions of the points kept of n; of fewer points than `offset` the first."""
        if self.every is not None:
            return np.arange(min(self.offset, n - 1), n, self.every)
        count = min(self.count or 0, n)
        return np.arange(count) * n // count

    def condition(self, X: Array, y: Array) -> ExactPosterior:
        """The exact posterior given the points kept of X (n, D) and centred y (n,)."""
        X, y = checked_data(X, y)
        selected = self.keep(len(y))
        return self.gp.condition(X[selected], y[selected])

    def log_marginal_likelihood(self, X: Array, y: Array) -> tuple[float, Array]:
        """log p of the points kept, and its gradient (P + 1,) with respect to `gp.parameters`."""
        X, y = checked_data(X, y)
        selected = self.keep(len(y))
        return self.gp.log_marginal_likelihood(X[selected], y[selected])
