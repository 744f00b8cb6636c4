"""Linear regression in given features with a Gaussian prior on the weights: a process of finite rank.

y = phi(x)^T w + noise, w ~ N(0, s0^2 I): covariance s0^2 phi(x)^T phi(z). Learning costs n p^2 and prediction
p^2, whatever n (Bishop 2006, 3.3).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.linalg import solve_triangular

from etude.errors import NumericalError, UsageError
from etude.models.gp.exact import checked_data
from etude.types import Array


class Features(Protocol):
    """p functions of D inputs."""

    def transform(self, X: Array) -> Array:
        """phi (n, p) at X (n, D)."""
        ...

    def pullback(self, X: Array, G: Array) -> Array:
        """Gradient (n, D) of sum(G * transform(X)) with respect to X; G is (n, p)."""
        ...


@dataclass(frozen=True)
class BayesianLinear:
    """Linear regression before any data; zero mean, so the caller centres the outputs.

    Choose it when the form of the function is known, as a robot's regressor is. Its variance is honest about
    the weights and knows nothing of what the features cannot express: off the data it grows only along the
    features, so a wrong form is wrong with confidence.

    Attributes:
        features: scaled so that all weights have the same prior deviation.
        log_amplitude: log s0, that deviation in output units.
        log_noise: log of the noise deviation.
    """

    features: Features
    log_amplitude: float
    log_noise: float

    def __post_init__(self) -> None:
        if not np.isfinite([self.log_amplitude, self.log_noise]).all():
            raise UsageError(
                f"log amplitude and log noise must be finite, got {self.log_amplitude} and {self.log_noise}"
            )

    @property
    def parameters(self) -> Array:
        """(log s0, log sn): what training moves."""
        return np.array([self.log_amplitude, self.log_noise])

    def with_parameters(self, parameters: Array) -> BayesianLinear:
        """The same features with another (log s0, log sn); UsageError if that is not two numbers."""
        parameters = np.asarray(parameters, dtype=float)
        if parameters.shape != (2,):
            raise UsageError(
                f"expected log amplitude and log noise, got a vector of shape {parameters.shape}"
            )
        return BayesianLinear(self.features, float(parameters[0]), float(parameters[1]))

    def condition(self, X: Array, y: Array) -> LinearPosterior:
        """The posterior given X (n, D) and centred y (n,); n < p is fine, the prior decides the rest.

        Raises DataError for unusable X or y, NumericalError if a feature is not finite.
        """
        X, y = checked_data(X, y)
        phi = self.features.transform(X)
        if not np.isfinite(phi).all():
            raise NumericalError("a feature is not finite at the training inputs")
        # the triangle of A = phi^T phi + (sn/s0)^2 I without squaring the condition of phi
        stacked = np.concatenate([phi, np.exp(self.log_noise - self.log_amplitude) * np.eye(phi.shape[1])])
        Q, R = np.linalg.qr(stacked)
        weights = solve_triangular(R, Q[: len(y)].T @ y)
        return LinearPosterior(self, X, y, phi, R, weights)

    def log_marginal_likelihood(self, X: Array, y: Array) -> tuple[float, Array]:
        """log p(y | X) and its gradient (2,) with respect to `parameters`; errors as `condition`."""
        posterior = self.condition(X, y)
        n, p = posterior.phi.shape
        noise, prior = np.exp(2.0 * self.log_noise), np.exp(2.0 * self.log_amplitude)
        squared = float(np.sum((posterior.y - posterior.phi @ posterior.weights) ** 2)) / noise
        shrunk = float(posterior.weights @ posterior.weights) / prior
        log_det = 2.0 * float(np.log(np.abs(posterior.R.diagonal())).sum()) - p * np.log(noise / prior)
        value = -0.5 * (squared + shrunk + log_det + n * np.log(2.0 * np.pi * noise))
        determined = p - noise / prior * float(np.sum(posterior.R_inverse**2))  # tr A^-1 phi^T phi
        return float(value), np.array([shrunk - determined, squared - (n - determined)])


@dataclass(frozen=True)
class LinearPosterior:
    """Weights conditioned on n samples (implements `protocols.Posterior`). Variances are latent.

    Attributes:
        prior: the regression it came from.
        X, y: (n, D) inputs and (n,) centred outputs; phi: (n, p) features of X.
        R: (p, p) upper triangular with R^T R = A = phi^T phi + (sn/s0)^2 I.
        weights: (p,) mean of the weights; their covariance is sn^2 A^-1.
    """

    prior: BayesianLinear
    X: Array
    y: Array
    phi: Array
    R: Array
    weights: Array

    @property
    def noise_variance(self) -> float:
        """sn^2."""
        return float(np.exp(2.0 * self.prior.log_noise))

    @cached_property
    def signal_variance(self) -> float:
        """Prior variance s0^2 |phi|^2, averaged over the training inputs."""
        return float(np.exp(2.0 * self.prior.log_amplitude) * np.mean(np.sum(self.phi**2, axis=1)))

    @cached_property
    def R_inverse(self) -> Array:
        """R^-1 (p, p), upper triangular."""
        return np.asarray(solve_triangular(self.R, np.eye(len(self.R))))

    def factors(self, X: Array) -> LinearFactors:
        """What covariances and gradients at X (T, D) share; keep it for inputs that stay."""
        X = self._inputs(X)
        root = np.exp(self.prior.log_noise) * self.R_inverse
        return LinearFactors(self.prior.features, X, self.prior.features.transform(X) @ root, root)

    def predict(self, X: Array) -> tuple[Array, Array]:
        """Mean (T,) and latent variance (T,)."""
        X = self._inputs(X)
        return self.prior.features.transform(X) @ self.weights, self.factors(X).variance()

    def covariance(self, X: Array, Z: Array) -> Array:
        """Posterior covariance (T, r) of the latent function between X (T, D) and Z (r, D)."""
        return self.factors(X).covariance(self.factors(Z))

    def covariance_gradient(self, X: Array, Z: Array, G: Array) -> Array:
        """Gradient (T, D) of sum(G * covariance(X, Z)) with respect to X, Z held fixed; G is (T, r)."""
        return self.factors(X).gradient(cross=(self.factors(Z), G))

    def variance_gradient(self, X: Array, g: Array) -> Array:
        """Gradient (T, D) of sum(g * variance(X)) with respect to X; g is (T,)."""
        return self.factors(X).gradient(variance=g)

    def mean_gradient(self, X: Array) -> Array:
        """Gradient (T, D) of the mean at each row of X."""
        X = self._inputs(X)
        return self.prior.features.pullback(X, np.tile(self.weights, (len(X), 1)))

    def _inputs(self, X: Array) -> Array:
        X = np.asarray(X, dtype=float)
        if X.ndim != 2 or X.shape[1] != self.X.shape[1]:
            raise UsageError(f"expected inputs of shape (T, {self.X.shape[1]}), got {X.shape}")
        return X


@dataclass(frozen=True)
class LinearFactors:
    """Posterior covariances F F^T of a batch of inputs and their gradients.

    Attributes:
        F: (T, p) features times `root`; root: (p, p) with root root^T the covariance of the weights.
    """

    features: Features
    X: Array
    F: Array
    root: Array

    def variance(self) -> Array:
        """Latent variance (T,)."""
        return np.asarray(np.einsum("tp,tp->t", self.F, self.F))

    def covariance(self, other: LinearFactors | None = None) -> Array:
        """Posterior covariance (T, r) with another set of inputs, or (T, T) with itself."""
        return np.asarray(self.F @ (self if other is None else other).F.T)

    def gradient(
        self,
        *,
        variance: Array | None = None,
        own: Array | None = None,
        cross: tuple[LinearFactors, Array] | None = None,
        reduction: tuple[LinearFactors, Array, Array] | None = None,
    ) -> Array:
        """Gradient (T, D) in X of the sum of the terms given, as `CovarianceFactors.gradient`."""
        in_F = np.zeros_like(self.F)
        if variance is not None:
            in_F += 2.0 * variance[:, None] * self.F
        if own is not None:
            in_F += (own + own.T) @ self.F
        if cross is not None:
            in_F += cross[1] @ cross[0].F
        if reduction is not None:
            other, A, B = reduction  # own = -A B^T, cross = 2 A
            in_F += 2.0 * A @ other.F - A @ (B.T @ self.F) - B @ (A.T @ self.F)
        return self.features.pullback(self.X, in_F @ self.root.T)
