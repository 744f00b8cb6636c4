"""What a design of a flight sees of a model: few processes, with little to compute, and planned noise."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from etude.models.contracts import Posterior
from etude.models.gp.exact import ExactPosterior
from etude.models.gp.inducing import InducingGP
from etude.models.gp.inducing_training import greedy_points

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PlannedPosterior:
    """A posterior whose samples count as planned ones: fewer than will be logged, each with less noise.

    Attributes:
        posterior: the model's.
        noise_variance: of a planned sample: sn^2 times planned over logged samples.
    """

    posterior: Posterior
    noise_variance: float

    @property
    def signal_variance(self) -> float:
        return self.posterior.signal_variance

    @property
    def factors(self) -> Callable[[Array], Any] | None:
        """The posterior's shared factors, if it has them (see `batch.batch_of`)."""
        return getattr(self.posterior, "factors", None)

    def predict(self, X: Array) -> tuple[Array, Array]:
        return self.posterior.predict(X)

    def covariance(self, X: Array, Z: Array) -> Array:
        return self.posterior.covariance(X, Z)

    def covariance_gradient(self, X: Array, Z: Array, G: Array) -> Array:
        return self.posterior.covariance_gradient(X, Z, G)

    def variance_gradient(self, X: Array, g: Array) -> Array:
        return self.posterior.variance_gradient(X, g)

    def mean_gradient(self, X: Array) -> Array:
        return self.posterior.mean_gradient(X)


def planned_posteriors(posteriors: Sequence[Posterior], share: float, count: int) -> list[PlannedPosterior]:
    """The posteriors that differ in their covariances, each with at most `count` basis points.

    Args:
        posteriors: of the model's outputs.
        share: planned over logged samples.
        count: inducing points.
    """
    return [
        PlannedPosterior(fast_posterior(posterior, count), posterior.noise_variance * share)
        for posterior in distinct(posteriors)
    ]


def distinct(posteriors: Sequence[Posterior]) -> list[Posterior]:
    """One posterior for each covariance: outputs of a shared kernel hold the same factor."""
    kept: dict[int, Posterior] = {}
    for posterior in posteriors:
        kept.setdefault(id(getattr(posterior, "L", posterior)), posterior)
    return list(kept.values())


def fast_posterior(posterior: Posterior, count: int) -> Posterior:
    """An exact posterior seen through its `count` most telling samples; any other one as it is.

    All samples still count (Titsias 2009, whose variance is that of DTC); hyperparameters stay. The samples
    are those that a pivoted Cholesky factorisation takes first.
    """
    if not isinstance(posterior, ExactPosterior) or len(posterior.X) <= count:
        return posterior
    kernel, theta, X = posterior.kernel, posterior.theta, posterior.X
    Z = X[greedy_points(kernel, theta, X, count)]
    log_noise = 0.5 * math.log(posterior.noise_variance)
    return InducingGP(kernel, theta, log_noise, Z).condition(X, posterior.y)
