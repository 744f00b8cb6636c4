"""Sparse spectrum Gaussian process regression (SSGP): the prior, and the likelihood.

Lázaro-Gredilla, Quiñonero-Candela, Rasmussen and Figueiras-Vidal 2010; thesis 2.4. With m spectral points the
squared exponential covariance becomes that of 2m cosines and sines whose weights have variance s0²/m:
O(n m²) to learn, O(m) for a mean and O(m²) for a variance, whatever n.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from etude._runtime.scipy_parts import dpotrs
from etude.errors import NumericalError, UsageError
from etude.models.gp.cholesky import factorise, inverse_lower
from etude.models.gp.exact import checked_data
from etude.threads import threads_for
from etude.types import Array
from etude_sparse.spectral_posterior import SparseSpectrumPosterior, SpectralFeatures, in_phases

LARGEST = 100.0
"""Logarithms of hyperparameters beyond this are refused: their squares leave the floating-point range."""
ROWS = 512
"""Samples handled together in a gradient: a block of features that stays in the processor's cache."""


@dataclass(frozen=True)
class SparseSpectrumGP:
    """A sparse spectrum process with its hyperparameters; zero mean, so the caller centres the outputs.

    Choose it for many samples (thousands) and fast predictions of constant cost, or to learn on line
    (`incremental_spectrum`). Its covariance is periodic: far from the data the uncertainty does not return to
    the prior. With few spectral points the variance is much too small even nearby: median 0.4 of the full
    process's at m = 100 in six dimensions. Learned points make it smaller still. It ranks motions well, so it
    is fit for design and control; never stop or certify on it without a calibration on held-out motions.

    Attributes:
        points: (m, D) spectral points ε in units of 1/length: ω = ε/ℓ; N(0, I) for a squared exponential.
        theta: (D + 1,) log s0 and log ℓ_1 .. log ℓ_D, as `kernels.SquaredExponential`.
        log_noise: log of the learned noise deviation.
        noise_floor: deviation below which the noise cannot fall: sn² = floor² + exp(2 log_noise).
        learned: whether the points are among `parameters`; else they stay as drawn and ω moves with ℓ alone.
    """

    points: Array
    theta: Array
    log_noise: float
    noise_floor: float = 0.0
    learned: bool = False

    def __post_init__(self) -> None:
        points, theta = np.asarray(self.points, dtype=float), np.asarray(self.theta, dtype=float)
        if points.ndim != 2 or not points.size or not np.isfinite(points).all():
            raise UsageError(f"spectral points must be finite, of shape (m, D), m >= 1; got {points.shape}")
        if theta.shape != (points.shape[1] + 1,) or not np.isfinite(theta).all():
            raise UsageError(
                f"expected {points.shape[1] + 1} finite log hyperparameters for {points.shape[1]} inputs, "
                f"got a vector of shape {theta.shape}"
            )
        if not np.isfinite(self.log_noise):
            raise UsageError(f"log_noise must be finite, got {self.log_noise}")
        if not (np.isfinite(self.noise_floor) and self.noise_floor >= 0.0):
            raise UsageError(f"noise_floor must be a finite number >= 0, got {self.noise_floor}")
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "theta", theta)

    @property
    def noise_variance(self) -> float:
        """sn², floor included."""
        return float(self.noise_floor**2 + np.exp(2.0 * self.log_noise))

    @property
    def signal_variance(self) -> float:
        """s0² = k(x, x), everywhere."""
        return float(np.exp(2.0 * self.theta[0]))

    @property
    def features(self) -> SpectralFeatures:
        """The features at the frequencies ω = ε/ℓ."""
        return SpectralFeatures(self.points / np.exp(self.theta[1:]))

    @property
    def ridge(self) -> float:
        """m sn²/s0²: what the prior on the weights adds to the diagonal of A."""
        return len(self.points) * self.noise_variance / self.signal_variance

    @property
    def parameters(self) -> Array:
        """What training moves: theta, log_noise and, if learned, the points row by row; (D + 2 [+ m D],)."""
        hyperparameters = np.append(self.theta, self.log_noise)
        return np.append(hyperparameters, self.points.ravel()) if self.learned else hyperparameters

    def with_parameters(self, parameters: Array) -> SparseSpectrumGP:
        """The same process with another vector of `parameters`; UsageError if its length is wrong."""
        parameters = np.asarray(parameters, dtype=float)
        count = len(self.theta) + 1
        expected = count + self.points.size * self.learned
        if parameters.shape != (expected,):
            raise UsageError(
                f"expected {expected} parameters of {len(self.points)} "
                f"{'learned' if self.learned else 'fixed'} spectral points, got shape {parameters.shape}"
            )
        points = parameters[count:].reshape(self.points.shape) if self.learned else self.points
        return replace(
            self, points=points, theta=parameters[: count - 1], log_noise=float(parameters[count - 1])
        )

    def condition(self, X: Array, y: Array) -> SparseSpectrumPosterior:
        """The posterior given X (n, D) and centred y (n,); any n >= 1.

        Without noise and with n < 2m the weights are not determined. Noise is then added until they are, with
        a JitterWarning; the posterior's `noise_variance` includes it.

        Raises:
            DataError: unusable X or y. UsageError: X has another D. NumericalError: hyperparameters beyond
                the floating-point range, or features that cannot be computed.
        """
        X, y = self._checked(X, y)
        with threads_for(self._order(len(y))):
            fit = _Fit.of(self, X, y, announce=True)
        return SparseSpectrumPosterior(
            self.features, self.signal_variance, fit.noise_variance, fit.weights, fit.L, X, y, self.theta
        )

    def evidence(self, X: Array, y: Array) -> float:
        """log p(y | X) alone, at less than half the price of its gradient; errors as `condition`."""
        X, y = self._checked(X, y)
        with threads_for(self._order(len(y))):
            return _Fit.of(self, X, y).evidence()

    def log_marginal_likelihood(self, X: Array, y: Array) -> tuple[float, Array]:
        """log p(y | X) and its gradient with respect to `parameters`, O(n m²); errors as `condition`."""
        X, y = self._checked(X, y)
        with threads_for(self._order(len(y))):
            fit = _Fit.of(self, X, y)
            return fit.evidence(), -fit.gradient(self, X)

    def _checked(self, X: Array, y: Array) -> tuple[Array, Array]:
        X, y = checked_data(X, y)
        if X.shape[1] != self.points.shape[1]:
            raise UsageError(f"the spectral points have {self.points.shape[1]} inputs, the data {X.shape[1]}")
        if np.abs(np.append(self.theta, self.log_noise)).max() > LARGEST:
            raise NumericalError("hyperparameters beyond the floating-point range")
        return X, y

    def _order(self, n: int) -> int:
        """The order of a square matrix product that costs as much as the normal equations."""
        return int(np.cbrt(4.0 * n * len(self.points) ** 2))


@dataclass(frozen=True, eq=False)
class _Fit:
    """The weights' normal equations, solved.

    Attributes:
        P: (n, 2m) features. L: (2m, 2m) lower Cholesky factor of A = PᵀP + (m sn²/s0²) I.
        weights: (2m,) A^-1 Pᵀy. residual: (n,) y - P A^-1 Pᵀ y.
        ridge, noise_variance: those in use, more than the process's where A was indefinite to rounding.
    """

    P: Array
    L: Array
    weights: Array
    residual: Array
    ridge: float
    noise_variance: float

    @classmethod
    def of(cls, gp: SparseSpectrumGP, X: Array, y: Array, *, announce: bool = False) -> _Fit:
        P = gp.features.transform(X)
        if not np.isfinite(P).all():
            raise NumericalError("spectral features are not finite", next_step="Scale the inputs.")
        L, jitter = factorise((P.T @ P).T, gp.ridge, announce=announce)
        weights, _ = dpotrs(L, P.T @ y, lower=1)
        ridge = gp.ridge + jitter
        noise_variance = ridge * gp.signal_variance / len(gp.points)
        return cls(P, L, weights, y - P @ weights, ridge, noise_variance)

    def evidence(self) -> float:
        """log p(y | X) with [yᵀy - bᵀA^-1b] as the sum of squares it is, so that nothing cancels."""
        n, m = len(self.residual), self.P.shape[1] // 2
        squares = self.residual @ self.residual + self.ridge * (self.weights @ self.weights)
        half_log_det = np.log(self.L.diagonal()).sum() - m * np.log(self.ridge)
        noise = n * np.log(2.0 * np.pi * self.noise_variance)
        return -float(0.5 * squares / self.noise_variance + half_log_det + 0.5 * noise)

    def gradient(self, gp: SparseSpectrumGP, X: Array) -> Array:
        """Gradient of minus `evidence` in the parameters of `gp`.

        With W = K_y^-1, α = W y and w = A^-1 b, PᵀP = A - ridge I turns the gradient in the features,
        (s0²/m)(W P - α αᵀP), into P A^-1 - α wᵀ: one product of n x 2m x 2m.
        """
        inverse = inverse_lower(self.L.copy(order="F"))
        determined = self.P.shape[1] - self.ridge * float(np.trace(inverse))  # tr A^-1 PᵀP
        shrunk = self.ridge / self.noise_variance * float(self.weights @ self.weights)
        misfit = float(self.residual @ self.residual) / self.noise_variance
        learned = np.exp(2.0 * gp.log_noise) / gp.noise_variance
        in_frequencies = self._in_frequencies(X, inverse + np.tril(inverse, -1).T)
        in_lengths = -np.einsum("md,md->d", in_frequencies, gp.features.frequencies)
        in_noise = learned * (len(X) - determined - misfit)
        gradient = np.concatenate([[determined - shrunk], in_lengths, [in_noise]])
        if not gp.learned:
            return gradient
        return np.append(gradient, (in_frequencies / np.exp(gp.theta[1:])).ravel())

    def _in_frequencies(self, X: Array, inverse: Array) -> Array:
        """(m, D) gradient in ω, a block of samples at a time, without another n x 2m array."""
        alpha = self.residual / self.noise_variance
        total = np.zeros((self.P.shape[1] // 2, X.shape[1]))
        for first in range(0, len(X), ROWS):
            rows = slice(first, first + ROWS)
            G = self.P[rows] @ inverse
            G -= alpha[rows, None] * self.weights
            total += in_phases(self.P[rows], G).T @ X[rows]
        return total
