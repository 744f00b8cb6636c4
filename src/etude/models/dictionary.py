"""Dictionary GPR (thesis 2.5): an exact process on a fixed number of points, chosen as they stream past."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError, UsageError
from etude.models.exact import ExactGP, ExactPosterior, checked_data

if TYPE_CHECKING:
    from etude.models.dictionary_stream import DictionaryStream

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class DictionaryConfig:
    """How a dictionary chooses.

    Attributes:
        size: members u at most. A candidate costs O(u²), a refresh O(u³).
        rule: "variance", thesis (2.7): a candidate replaces the member that the others determine best, if
            they determine the candidate less; log det (K + d I) then never falls. "error", thesis (2.8): the
            same with the error |y* - y| of the prediction from the others.
        guard: of the error rule, which by itself collects outliers and noise, forgets the rest, and diverges
            online. A point is then worth its latent variance, and up to 1 + guard² times that if its error
            is large: as far as data there could reduce the error, and less again beyond `guard` standard
            deviations, where it is rather an outlier. None is the bare rule of the thesis.
        threshold: a candidate enters only if its deviation (variance rule) or error (error rule) exceeds this
            part of the prior deviation; the thesis's delta_t, for which it gives no number.
        gain: part by which a swap has to raise the score. With 0, the thesis's, members are dragged along the
            trajectory by ever so small gains: more swaps, and a smaller determinant at the end.
        half_life: s (or points, if no times are given) in which a member's score halves, so that old members
            give way although they are informative (the idea of Nguyen-Tuong and Peters 2011; the exponential
            is ours); None keeps them. With it log det may fall.
        refresh_every: replacements after which the inverse is computed anew.
    """

    size: int = 500
    rule: Literal["variance", "error"] = "variance"
    guard: float | None = 3.0
    threshold: float = 0.0
    gain: float = 0.1
    half_life: float | None = None
    refresh_every: int = 500

    def __post_init__(self) -> None:
        if self.rule not in ("variance", "error"):
            raise UsageError("rule must be 'variance' or 'error'", where=f"dictionary.rule = {self.rule!r}")
        for name in ("size", "refresh_every"):
            if getattr(self, name) < 1:
                raise UsageError(f"{name} must be at least 1", where=f"dictionary.{name}")
        for name in ("guard", "half_life"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise UsageError(f"{name} must be a positive number or absent", where=f"dictionary.{name}")
        for name in ("threshold", "gain"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise UsageError(f"{name} must be a number >= 0", where=f"dictionary.{name}")


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
    """Exact regression on a dictionary of the data (implements `contracts.Regressor`).

    Choose it when data keep coming and prediction must stay at a fixed cost: a stream of samples, an arm that
    learns while it moves. Its variance is that of the exact process on the members: honest about points that
    were dropped in that it never claims more than they could tell. With the error rule the choice depends on
    the outputs: noise trained on the members is then too large and the variance is not calibrated, even
    guarded; check it on data held out.

    Choose with the present hyperparameters, then train them on the kept points (thesis 6.1.1).
    """

    gp: ExactGP
    config: DictionaryConfig = DictionaryConfig()

    def stream(self, inputs: int) -> DictionaryStream:
        """An empty dictionary for points with that many inputs, to be updated as they come."""
        from etude.models.dictionary_stream import DictionaryStream

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
