"""The contracts of `models/`: what design, control and campaign may ask of a Gaussian process."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from etude.models.gp.kernels import Kernel

Array = NDArray[np.float64]


class Posterior(Protocol):
    """A scalar Gaussian process conditioned on data; D inputs. Variances are latent (without noise)."""

    @property
    def noise_variance(self) -> float:
        """sn^2, in squared output units."""
        ...

    @property
    def signal_variance(self) -> float:
        """Prior variance k(x, x), averaged over the training inputs; scales outputs against each other."""
        ...

    def predict(self, X: Array) -> tuple[Array, Array]:
        """Mean (T,) and latent variance (T,) at X (T, D). Thesis (2.5), (2.6)."""
        ...

    def covariance(self, X: Array, Z: Array) -> Array:
        """Posterior covariance (T, r) of the latent function between X (T, D) and Z (r, D)."""
        ...

    def covariance_gradient(self, X: Array, Z: Array, G: Array) -> Array:
        """Gradient (T, D) of sum(G * covariance(X, Z)) with respect to X, with Z held fixed; G is (T, r)."""
        ...

    def variance_gradient(self, X: Array, g: Array) -> Array:
        """Gradient (T, D) of sum(g * variance(X)) with respect to X; g is (T,)."""
        ...

    def mean_gradient(self, X: Array) -> Array:
        """Gradient (T, D) of the mean at each row of X."""
        ...


@runtime_checkable
class HasKernel(Protocol):
    """A posterior with a covariance function, so its hyperparameters can be compared or start a training."""

    @property
    def kernel(self) -> Kernel: ...

    @property
    def theta(self) -> Array:
        """(P,) log hyperparameters of `kernel`."""
        ...


class Regressor(Protocol):
    """A Gaussian process with its hyperparameters, before it has seen data."""

    def condition(self, X: Array, y: Array) -> Posterior:
        """The posterior given inputs X (n, D) and outputs y (n,)."""
        ...

    def log_marginal_likelihood(self, X: Array, y: Array) -> tuple[float, Array]:
        """log p(y | X) and its gradient with respect to `theta`, the log hyperparameters (P,)."""
        ...
