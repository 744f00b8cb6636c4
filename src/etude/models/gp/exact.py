"""Exact Gaussian process regression (thesis 2.2): marginal likelihood and posterior of one output."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from etude._runtime.scipy_parts import dpotrs
from etude.errors import DataError, UsageError
from etude.models.gp.cholesky import factorise, inverse_lower, triangular_inverse
from etude.models.gp.covariance_factors import CovarianceFactors, blocks, moments
from etude.models.gp.kernel_algebra import Against, Of
from etude.models.gp.kernels import Kernel, mean_signal
from etude.models.gp.likelihood_algebra import solved
from etude.threads import threads_for
from etude.types import Array

EVERY, FEW = 3, 200
"""Which points bound variances, and of how many it is not worth it."""


@dataclass(frozen=True)
class ExactGP:
    """A Gaussian process prior with its hyperparameters; zero mean, so the caller centres the outputs.

    Attributes:
        kernel: covariance function of the latent function.
        theta: (P,) its log hyperparameters.
        log_noise: log of the learned noise deviation.
        noise_floor: deviation below which the noise cannot fall: sn² = floor² + exp(2 log_noise). Smooth, so
            the gradient is exact. Samples of a smooth motion contain no near-duplicates, so without a floor
            the likelihood drives the noise to nothing, and both the error and the calibration collapse.
    """

    kernel: Kernel
    theta: Array
    log_noise: float
    noise_floor: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "theta", self.kernel.check(self.theta))
        if not np.isfinite(self.log_noise):
            raise UsageError(f"log_noise must be finite, got {self.log_noise}")
        if not (np.isfinite(self.noise_floor) and self.noise_floor >= 0.0):
            raise UsageError(f"noise_floor must be a finite number >= 0, got {self.noise_floor}")

    @property
    def noise_variance(self) -> float:
        """sn², floor included."""
        return float(self.noise_floor**2 + np.exp(2.0 * self.log_noise))

    @property
    def parameters(self) -> Array:
        """The kernel's theta followed by log_noise: what training moves, (P + 1,)."""
        return np.append(self.theta, self.log_noise)

    def with_parameters(self, parameters: Array) -> ExactGP:
        """The same process with another vector (P + 1,); UsageError if its length is wrong."""
        parameters = np.asarray(parameters, dtype=float)
        if parameters.shape != (self.kernel.size + 1,):
            raise UsageError(
                f"expected {self.kernel.size} kernel hyperparameters and log_noise, "
                f"got a vector of shape {parameters.shape}"
            )
        return replace(self, theta=parameters[:-1], log_noise=float(parameters[-1]))

    def log_marginal_likelihood(self, X: Array, y: Array) -> tuple[float, Array]:
        """log p(y | X) and its gradient (P + 1,) with respect to `parameters`.

        Costs little more than the Cholesky factorisation and inversion: no n x n x D array, two n x n ones.
        Raises DataError for unusable X (n, D) or y (n,), NumericalError if the covariance is indefinite.
        """
        X, y = checked_data(X, y)
        with threads_for(len(X)):
            return self._likelihood(X, y)

    def _likelihood(self, X: Array, y: Array) -> tuple[float, Array]:
        K, vjp = self.kernel.gram_lower(self.theta, X)
        solution = solved(K, self.noise_variance, y)
        value = -0.5 * (solution.square + solution.log_det + len(y) * np.log(2.0 * np.pi))
        in_theta, in_noise = solution.slopes(vjp)
        return float(value), -np.append(in_theta, 2.0 * np.exp(2.0 * self.log_noise) * in_noise)

    def condition(self, X: Array, y: Array) -> ExactPosterior:
        """The posterior given X (n, D) and centred y (n,); DataError and NumericalError as above."""
        return posterior_given(self.kernel, self.theta, self.noise_variance, X, y)


@dataclass(frozen=True)
class ExactPosterior:
    """A Gaussian process conditioned on n points (implements `protocols.Posterior`). Variances are latent.

    Its factor is computed at first use: most stored posteriors are used only in part.

    Attributes:
        X, y: (n, D) inputs and (n,) centred outputs.
    """

    form: ClassVar[str] = "exact"
    kernel: Kernel
    theta: Array
    noise_variance: float
    X: Array
    y: Array

    @cached_property
    def factor(self) -> tuple[Array, float]:
        """(n, n) lower Cholesky factor L of K_y = k(X, X) + (sn² + jitter) I, and the jitter.

        Raises NumericalError if the covariance is indefinite.
        """
        with threads_for(len(self.X)):
            return factorise(self.kernel.gram_lower(self.theta, self.X)[0], self.noise_variance)

    @property
    def L(self) -> Array:
        """(n, n) of `factor`."""
        return self.factor[0]

    @property
    def jitter(self) -> float:
        """Of `factor`."""
        return self.factor[1]

    @cached_property
    def alpha(self) -> Array:
        """(n,) K_y^-1 y."""
        return np.asarray(dpotrs(self.L, self.y, lower=1)[0])

    @cached_property
    def signal_variance(self) -> float:
        """Mean of k(x, x) over the training inputs, without noise at rest."""
        return mean_signal(self.kernel, self.theta, self.X)

    @cached_property
    def L_inverse(self) -> Array:
        """L^-1 (n, n), made once: every prediction and gradient is then a triangular product."""
        return triangular_inverse(self.L)

    @cached_property
    def _against(self) -> Against:
        return self.kernel.against(self.theta, self.X)

    @cached_property
    def _values(self) -> Of:
        return self.kernel.values(self.theta, self.X)

    @cached_property
    def _sums(self) -> Of:
        return self.kernel.sums(self.theta, self.X, self.alpha)

    def factors(self, X: Array) -> CovarianceFactors:
        """What covariances and gradients at X (T, D) share; keep it for inputs that stay."""
        X = self._inputs(X)
        K, vjp = self._against(X)
        return CovarianceFactors.of(self.kernel, self.theta, self.L_inverse, X, K, vjp)

    def predict(self, X: Array) -> tuple[Array, Array]:
        """Mean (T,) and latent variance (T,), thesis (2.5) and (2.6)."""
        X = self._inputs(X)
        with threads_for(len(self.X)):
            prior = self.kernel.diagonal(self.theta, X)
            return moments(self._values, self.alpha, self.L_inverse, X, prior)

    def at_most(self, X: Array) -> tuple[Array, Array]:
        """Mean (T,), and variances (T,) that are never below the latent ones: those given fewer points.

        More points never say less: the variance given a part of them is an upper bound. A ninth of the price.
        """
        if len(self.X) < FEW:
            return self.predict(X)
        return self.mean(X), self._thinned.predict(X)[1]

    @cached_property
    def _thinned(self) -> ExactPosterior:
        rows = slice(None, None, EVERY)
        return ExactPosterior(self.kernel, self.theta, self.noise_variance, self.X[rows], self.y[rows])

    @threads_for(0)  # the products are as narrow as the inputs
    def mean(self, X: Array) -> Array:
        """Mean (T,) alone, thesis (2.5): O(n) a point."""
        X = self._inputs(X)
        mean, sums = np.empty(len(X)), self._sums
        for rows in blocks(len(X)):
            mean[rows] = sums(X[rows])
        return mean

    def covariance(self, X: Array, Z: Array) -> Array:
        """Posterior covariance (T, r) of the latent function between X (T, D) and Z (r, D)."""
        with threads_for(len(self.X)):
            return self.factors(X).covariance(self.factors(Z))

    def covariance_gradient(self, X: Array, Z: Array, G: Array) -> Array:
        """Gradient (T, D) of sum(G * covariance(X, Z)) with respect to X, Z held fixed; G is (T, r)."""
        with threads_for(len(self.X)):
            return self.factors(X).gradient(cross=(self.factors(Z), G))

    def variance_gradient(self, X: Array, g: Array) -> Array:
        """Gradient (T, D) of sum(g * variance(X)) with respect to X; g is (T,)."""
        with threads_for(len(self.X)):
            return self.factors(X).gradient(variance=g)

    def mean_gradient(self, X: Array) -> Array:
        """Gradient (T, D) of the mean at each row of X."""
        X = self._inputs(X)
        _, vjp = self.kernel.cross(self.theta, X, self.X)
        return vjp(np.broadcast_to(self.alpha, (len(X), len(self.X))))

    @cached_property
    def inverse(self) -> Array:
        """W = K_y^-1, (n, n), both halves."""
        with threads_for(len(self.X)):
            W = inverse_lower(self.L.copy(order="F"))
        return W + np.tril(W, -1).T

    def _inputs(self, X: Array) -> Array:
        X = np.asarray(X, dtype=float)
        if X.ndim != 2 or X.shape[1] != self.X.shape[1]:
            raise UsageError(f"expected inputs of shape (T, {self.X.shape[1]}), got {X.shape}")
        return X


def posterior_given(
    kernel: Kernel, theta: Array, noise_variance: float, X: Array, y: Array
) -> ExactPosterior:
    """The posterior of hyperparameters theta (P,) and sn² given X (n, D) and centred y (n,).

    Raises DataError for unusable X or y, NumericalError if the covariance is indefinite.
    """
    posterior = ExactPosterior(kernel, theta, noise_variance, *checked_data(X, y))
    _ = posterior.alpha  # computed at once, so that errors arise here
    return posterior


def checked_data(X: Array, y: Array) -> tuple[Array, Array]:
    """X (n, D) and y (n,) as float arrays; DataError if they do not fit together or are not finite."""
    X, y = np.asarray(X, dtype=float), np.asarray(y, dtype=float)
    if X.ndim != 2 or y.ndim != 1 or len(X) != len(y) or not len(y):
        raise DataError(f"training needs inputs (n, D) and outputs (n,), n >= 1; got {X.shape} and {y.shape}")
    if not (np.isfinite(X).all() and np.isfinite(y).all()):
        raise DataError("training data contain NaN or infinite values", next_step="Repair the log first.")
    return X, y


def checked_outputs(X: Array, Y: Array) -> tuple[Array, Array]:
    """As `checked_data`, for outputs (n,) or several columns of them (n, m), m >= 1."""
    Y = np.asarray(Y, dtype=float)
    if Y.ndim != 2:
        return checked_data(X, Y)
    if not Y.shape[1]:
        raise DataError(f"training needs outputs (n, m), m >= 1; got {Y.shape}")
    X, _ = checked_data(X, Y[:, 0])
    if not np.isfinite(Y).all():
        raise DataError("training data contain NaN or infinite values", next_step="Repair the log first.")
    return X, Y


def columns_of(Y: Array) -> list[Array]:
    """The outputs one by one, (n,) each: of Y (n,) itself, of (n, m) its columns."""
    return [Y] if Y.ndim == 1 else [np.ascontiguousarray(y) for y in Y.T]
