"""Members without covariances between inputs, and the process that stands in for them in a design."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from etude.models.contracts import HasKernel, Posterior

if TYPE_CHECKING:
    from etude.models.gp.kernels import Kernel

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GuidedPosterior:
    """Predicts as `own`, which has no covariances; the next motion is designed with `guide`, which has.

    Implements `contracts.Posterior` as far as `own` does. Its kernel and hyperparameters are the guide's.

    Attributes:
        own: what the member learned.
        guide: an exact process on the samples kept, for the same output.
    """

    own: Posterior
    guide: Posterior

    @property
    def kernel(self) -> Kernel:
        assert isinstance(self.guide, HasKernel)
        return self.guide.kernel

    @property
    def theta(self) -> Array:
        """(P,) log hyperparameters of the guide."""
        assert isinstance(self.guide, HasKernel)
        return self.guide.theta

    @property
    def noise_variance(self) -> float:
        """As `own`'s."""
        return self.own.noise_variance

    @property
    def signal_variance(self) -> float:
        """As `own`'s."""
        return self.own.signal_variance

    def predict(self, X: Array) -> tuple[Array, Array]:
        """Mean (T,) and variance (T,) of `own` at X (T, D)."""
        return self.own.predict(X)

    def mean_gradient(self, X: Array) -> Array:
        """As `own`'s, (T, D)."""
        return self.own.mean_gradient(X)

    def variance_gradient(self, X: Array, g: Array) -> Array:
        """As `own`'s, (T, D)."""
        return self.own.variance_gradient(X, g)

    def covariance(self, X: Array, Z: Array) -> Array:
        """As `own`: a UsageError that says so."""
        return self.own.covariance(X, Z)

    def covariance_gradient(self, X: Array, Z: Array, G: Array) -> Array:
        """As `own`: a UsageError that says so."""
        return self.own.covariance_gradient(X, Z, G)


def guide_of(posterior: Posterior) -> Posterior:
    """The posterior to design with: the guide of a guided one, else the posterior itself."""
    return posterior.guide if isinstance(posterior, GuidedPosterior) else posterior
