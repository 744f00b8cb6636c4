"""Dictionary GPR (thesis 2.5): an exact process on a fixed number of points, chosen as they stream past."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from etude.errors import DataError, UsageError
from etude.models.gp.exact import ExactGP, ExactPosterior, checked_data
from etude.types import Array, Index
from etude_sparse.dictionary_stream import DictionaryConfig

if TYPE_CHECKING:
    from etude_sparse.dictionary_stream import DictionaryStream

__all__ = ["Dictionary", "DictionaryConfig", "DictionaryGP"]


@dataclass(frozen=True, eq=False)
class Dictionary:
    """What a selection left.

    Attributes:
        kept: (m,) positions of the members in the data that were offered.
        posterior: the exact process given the members. Its noise variance is max(sn², 1e-6 s0²).
        log_det: log det (K + d I) of the members.
        replacements, refreshes: how often a member was replaced and the inverse computed anew.
    """

    kept: Index
    posterior: ExactPosterior
    log_det: float
    replacements: int
    refreshes: int


@dataclass(frozen=True)
class DictionaryGP:
    """Exact regression on a dictionary of the data (implements `protocols.Regressor`).

    Choose it when data keep coming and prediction must stay at a fixed cost: a stream of samples, an arm that
    learns while it moves. Its variance is that of the exact process on the members, and never below that of
    the exact process on all samples with the same hyperparameters. With the error rule the choice depends on
    the outputs. Noise trained on the members is then too large, and the variance is not calibrated, even
    guarded. Check it on held-out data.

    Choose with the present hyperparameters, then train them on the kept points (thesis 6.1.1).
    """

    gp: ExactGP
    config: DictionaryConfig = field(default_factory=DictionaryConfig)

    def stream(self, inputs: int) -> DictionaryStream:
        """An empty dictionary for points with that many inputs, to be updated as they come."""
        from etude_sparse.dictionary_stream import DictionaryStream

        return DictionaryStream(self.gp, self.config, inputs)

    def select(self, X: Array, y: Array, t: Array | None = None, start: Index | None = None) -> Dictionary:
        """The dictionary of X (n, D) and centred y (n,), offered in their order.

        Args:
            t: (n,) times in s for the age weight.
            start: (s,) positions of distinct points to fill it with first, increasing (an even spread, say);
                by default the first points fill it.

        Raises:
            DataError: unusable data, or a threshold that no point passed. UsageError: unusable `start`.
        """
        X, y = checked_data(X, y)
        t = np.arange(len(y), dtype=float) if t is None else np.asarray(t, dtype=float)
        if t.shape != y.shape:
            raise DataError(f"one time per point: {len(y)} points, times of shape {t.shape}")
        order = _offering_order(len(y), start)
        first = 0 if start is None else len(start)
        stream = self.stream(X.shape[1])
        for part in (order[:first], order[first:]):
            if len(part):
                stream.offer(X[part], y[part], t[part])
        return Dictionary(
            order[stream.kept], stream.posterior(), stream.log_det, stream.replacements, stream.refreshes
        )

    def condition(self, X: Array, y: Array) -> ExactPosterior:
        """The posterior given the points that `select` keeps of X (n, D) and centred y (n,)."""
        return self.select(X, y).posterior

    def log_marginal_likelihood(self, X: Array, y: Array) -> tuple[float, Array]:
        """That of the exact process on all of X and y, with its gradient: pass the kept points to train."""
        return self.gp.log_marginal_likelihood(X, y)


def _offering_order(n: int, start: Index | None) -> Index:
    order = np.arange(n)
    if start is None:
        return order
    start = np.asarray(start)
    if start.ndim != 1 or start.dtype.kind not in "iu" or np.any(np.diff(start) <= 0):
        raise UsageError("start must be increasing positions")
    if len(start) and not (start[0] >= 0 and start[-1] < n):
        raise UsageError(f"start must lie within the {n} points, got {start[0]} to {start[-1]}")
    return np.concatenate([start, np.setdiff1d(order, start)])
