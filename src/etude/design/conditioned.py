"""A posterior that is also given planned samples: its variances do not depend on what they will say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from etude.design.batch import Batch, batch_of
from etude.design.score import RESOLUTION
from etude.models.gp.cholesky import factorise, triangular_inverse
from etude.models.gp.exact import ExactPosterior, posterior_given
from etude.protocols import Posterior
from etude.types import Array

HALF = 0.5
"""Weight from which a planned sample counts as a whole one of an exact process, of one noise for all."""


def given_planned(posterior: Posterior, X: Array, gains: Array) -> Posterior:
    """The posterior given samples at X (p, D) with gains (p,) that nobody has measured yet.

    An exact process is refitted, as nothing is cheaper to design with: with those samples that would not be
    masked, at its own mean, so that its mean stays. Any other is seen through `Conditioned`.
    """
    if not isinstance(posterior, ExactPosterior):
        return Conditioned.on(posterior, X, gains)
    told = X[gains**2 >= HALF]
    if not len(told):
        return posterior
    known = np.concatenate([posterior.X, told]), np.concatenate([posterior.y, posterior.mean(told)])
    refit = posterior_given(posterior.kernel, posterior.theta, posterior.noise_variance, *known)
    refit.__dict__["signal_variance"] = posterior.signal_variance  # the measure of all segments alike
    return refit


@dataclass(frozen=True, eq=False)
class Conditioned:
    """Any posterior, given samples at X (p, D) with gains d (p,) that nobody has measured yet.

    With B = cov(., X) d L^-T and L Lᵀ = d C_XX d + sn^2 I its covariance is cov(., .) - B Bᵀ. A sample of
    gain 0 (a joint that stands) changes nothing. Means stay.

    Attributes:
        posterior: without the planned samples.
        planned: of X, a batch of it.
        root: (p, p) L^-1 d.
    """

    posterior: Posterior
    planned: Batch
    root: Array

    @classmethod
    def on(cls, posterior: Posterior, X: Array, gains: Array) -> Conditioned:
        """The posterior given planned samples at X (p, D), p >= 1, with gains (p,)."""
        planned = batch_of(posterior, X)
        noise = max(posterior.noise_variance, RESOLUTION * posterior.signal_variance)
        weighed = np.asfortranarray(gains[:, None] * planned.covariance() * gains)
        L, _ = factorise(weighed, noise, announce=False)
        return cls(posterior, planned, triangular_inverse(L) * gains)

    @property
    def noise_variance(self) -> float:
        return self.posterior.noise_variance

    @property
    def signal_variance(self) -> float:
        return self.posterior.signal_variance

    def __getattr__(self, name: str) -> Any:
        if name == "X":  # the samples learned so far, which criteria of parameters ask for
            return getattr(self.posterior, name)
        raise AttributeError(name)

    def factors(self, X: Array) -> ConditionedBatch:
        """What covariances and gradients at X (T, D) share."""
        base = batch_of(self.posterior, X)
        return ConditionedBatch(self, base, base.covariance(self.planned) @ self.root.T)

    def predict(self, X: Array) -> tuple[Array, Array]:
        return self.posterior.predict(X)[0], self.factors(X).variance()

    def mean_gradient(self, X: Array) -> Array:
        return self.posterior.mean_gradient(X)

    def variance_gradient(self, X: Array, g: Array) -> Array:
        return self.factors(X).gradient(variance=g)

    def covariance(self, X: Array, Z: Array) -> Array:
        return self.factors(X).covariance(self.factors(Z))

    def covariance_gradient(self, X: Array, Z: Array, G: Array) -> Array:
        return self.factors(X).gradient(cross=(self.factors(Z), G))


@dataclass(frozen=True, eq=False)
class ConditionedBatch:
    """Implements `batch.Batch`. base: of the posterior without the planned samples; explained: B (T, p)."""

    given: Conditioned
    base: Batch
    explained: Array

    def variance(self) -> Array:
        return np.asarray(np.maximum(self.base.variance() - (self.explained**2).sum(axis=1), 0.0))

    def covariance(self, other: ConditionedBatch | None = None) -> Array:
        known = self if other is None else other
        prior = self.base.covariance(None if other is None else other.base)
        return np.asarray(prior - self.explained @ known.explained.T)

    def gradient(
        self,
        *,
        variance: Array | None = None,
        own: Array | None = None,
        cross: tuple[ConditionedBatch, Array] | None = None,
        reduction: tuple[ConditionedBatch, Array, Array] | None = None,
    ) -> Array:
        """Through the base, and through B: its weights lead back to the covariances with X."""
        B, weights = self.explained, np.zeros_like(self.explained)
        if variance is not None:
            weights -= 2.0 * variance[:, None] * B
        if own is not None:
            weights -= (own + own.T) @ B
        if cross is not None:
            weights -= cross[1] @ cross[0].explained
        if reduction is not None:
            other, left, right = reduction
            weights += 2.0 * left @ (right.T @ B - other.explained)
        through = self.base.gradient(
            variance=variance,
            own=own,
            cross=None if cross is None else (cross[0].base, cross[1]),
            reduction=None if reduction is None else (reduction[0].base, *reduction[1:]),
        )
        return through + self.base.gradient(cross=(self.given.planned, weights @ self.given.root))
