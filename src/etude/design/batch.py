"""A batch of inputs as one posterior sees it: covariances for a criterion, and the way back from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from etude.protocols import Posterior
from etude.types import Array


class Batch(Protocol):
    """Latent posterior covariances of inputs X (T, D); `models.gp.covariance_factors` shares factors."""

    def variance(self) -> Array:
        """(T,) latent variance."""
        ...

    def covariance(self, other: Any = None) -> Array:
        """(T, r) covariance with another batch, or (T, T) with itself."""
        ...

    def gradient(
        self,
        *,
        variance: Array | None = None,
        own: Array | None = None,
        cross: tuple[Any, Array] | None = None,
        reduction: tuple[Any, Array, Array] | None = None,
    ) -> Array:
        """Gradient (T, D) in X of sum(variance * var) + sum(own * C_TT) + sum(cross[1] * C_T,cross[0]).

        `reduction` = (other, A, B) stands for own = -A Bᵀ and cross = (other, 2 A).
        """
        ...


def batch_of(posterior: Posterior, X: Array) -> Batch:
    """The batch of X (T, D): with shared factors if the posterior has them, else by the bare contract."""
    factors = getattr(posterior, "factors", None)
    if factors is None:
        return PlainBatch(posterior, X)
    batch: Batch = factors(X)
    return batch


@dataclass(frozen=True)
class PlainBatch:
    """A batch for any posterior that keeps `protocols.Posterior` and no more."""

    posterior: Posterior
    X: Array

    def variance(self) -> Array:
        return self.posterior.predict(self.X)[1]

    def covariance(self, other: PlainBatch | None = None) -> Array:
        return self.posterior.covariance(self.X, self.X if other is None else other.X)

    def gradient(
        self,
        *,
        variance: Array | None = None,
        own: Array | None = None,
        cross: tuple[PlainBatch, Array] | None = None,
        reduction: tuple[PlainBatch, Array, Array] | None = None,
    ) -> Array:
        total = np.zeros_like(self.X)
        if reduction is not None:
            other, A, B = reduction
            total += self.gradient(own=-A @ B.T, cross=(other, 2.0 * A))
        if variance is not None:
            total += self.posterior.variance_gradient(self.X, variance)
        if own is not None:
            total += self.posterior.covariance_gradient(self.X, self.X, own + own.T)
        if cross is not None:
            other, weights = cross
            total += self.posterior.covariance_gradient(self.X, other.X, weights)
        return total
