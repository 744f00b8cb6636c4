"""Sparse online Gaussian process (Csató and Opper): one sample at a time, a bounded set of basis points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.linalg import qr_delete

from etude._runtime.scipy_parts import dtrmm, dtrtrs
from etude.errors import DataError, NumericalError, UsageError
from etude.models.gp.basis_posterior import BasisPosterior, lower_root
from etude.models.gp.cholesky import triangular_inverse
from etude.models.gp.exact import checked_data
from etude.models.gp.kernels import Kernel
from etude.models.gp.single_point import PointCovariances
from etude.threads import threads_for
from etude.types import Array

Deletion = Literal["A", "B"]

LEAST_NOISE = 1e-10
"""Least sn² as a part of the prior variance; below it the variance left is rounding."""
LEAST_TOLERANCE = 1e-8
"""Least novelty of a basis point as a part of its prior variance; below it the novelty is rounding."""
JITTER = 1e-12
"""Variance of each basis value's own, as a part of the prior variance: it bounds the rounding in L^-1."""


@dataclass(frozen=True)
class SOGP:
    """Sparse online Gaussian process with given hyperparameters; zero mean, so the caller centres y.

    Choose it to learn during operation at a bounded cost per sample, when every sample should count. A sample
    that is not kept is projected onto the basis points; a dictionary would discard it. It costs O(u²), and
    O(u³) with a small factor when a basis point is deleted: 0.4 ms at u = 100, some 3 ms at 300. It has no
    likelihood to train: take its hyperparameters from exact or inducing-point training. It never forgets, so
    it follows a changing robot slowly. Its variance is that of the exact process while no basis point was
    deleted and no sample projected. Afterwards it is an approximation: it depends on the outputs through the
    choice of deletions, and may rise with more data. Check z² on a held-out trajectory before using it.

    Csató and Opper 2002. Without deletions and with novel samples it equals exact regression in any order.

    Attributes:
        kernel, theta, log_noise, noise_floor: as in ExactGP.
        capacity: basis points kept, at most.
        deletion: "A" keeps mean and covariance at the remaining basis points as they were; "B" lets what was
            seen at the deleted point count as seen at its projection, so the mean there changes less.
        tolerance: a sample whose variance given the basis points, without noise, is at most this part of its
            prior variance is projected onto them.
    """

    kernel: Kernel
    theta: Array
    log_noise: float
    noise_floor: float = 0.0
    capacity: int = 200
    deletion: Deletion = "A"
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        object.__setattr__(self, "theta", self.kernel.check(self.theta))
        if not np.isfinite(self.log_noise):
            raise UsageError(f"log_noise must be finite, got {self.log_noise}")
        if not (np.isfinite(self.noise_floor) and self.noise_floor >= 0.0):
            raise UsageError(f"noise_floor must be a finite number >= 0, got {self.noise_floor}")
        if self.capacity < 1:
            raise UsageError(f"capacity must be at least 1, got {self.capacity}")
        if self.deletion not in ("A", "B"):
            raise UsageError(f'deletion must be "A" or "B", got {self.deletion!r}')
        if not LEAST_TOLERANCE <= self.tolerance < 1.0:
            raise UsageError(f"tolerance must be in [{LEAST_TOLERANCE:.0e}, 1), got {self.tolerance}")

    @property
    def noise_variance(self) -> float:
        """sn², floor included."""
        return float(self.noise_floor**2 + np.exp(2.0 * self.log_noise))

    def begin(self, inputs: int) -> OnlineProcess:
        """The process before its first sample, for inputs with that many columns."""
        return OnlineProcess(self, inputs)

    def condition(self, X: Array, y: Array) -> BasisPosterior:
        """The posterior after X (n, D) and centred y (n,), absorbed row by row.

        Raises DataError for unusable X or y, NumericalError if sn² is below 1e-10 of the prior variance.
        """
        X, y = checked_data(X, y)
        process = self.begin(X.shape[1])
        with threads_for(self.capacity):
            for x, target in zip(X, y, strict=True):
                process.update(x, float(target))
        return process.posterior()


class OnlineProcess:
    """What a SOGP has learned so far; `update` changes it, everything else leaves it as it is.

    With f(basis) = L z, L the Cholesky factor of k(basis, basis), the state is the posterior of z, N(m, S).
    In the paper's quantities alpha = L^-T m, Q = (L Lᵀ)^-1 and C = L^-T (S - I) L^-1. These can be huge where
    S and m are of order 1. On neighbouring samples of a smooth motion, recursions in Q and C diverge within
    some hundred samples; those in z do not.

    Attributes:
        samples: number absorbed.
        log_density: sum of the log densities of the outputs, each predicted before it was absorbed; the
            exact log marginal likelihood while nothing was deleted or projected.
        basis: (u, D) basis points.
    """

    def __init__(self, prior: SOGP, inputs: int) -> None:
        self.prior = prior
        self.samples, self.log_density, self._diagonal_sum = 0, 0.0, 0.0
        self.basis = np.zeros((0, inputs))
        self._point = PointCovariances(prior.kernel, prior.theta, inputs)
        self._L, self._S, self._m = np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0)
        self._weights: Array | None = None

    @property
    def alpha(self) -> Array:
        """(u,) weights: mean = k_uᵀ alpha."""
        return self._L_inverse.T @ self._m

    @property
    def C(self) -> Array:
        """(u, u): covariance = k + k_uᵀ C k_u."""
        T = self._L_inverse
        return np.asarray(T.T @ (self._S - np.eye(len(T))) @ T)

    @property
    def Q(self) -> Array:
        """(u, u): inverse of k(basis, basis)."""
        return np.asarray(self._L_inverse.T @ self._L_inverse)

    @property
    def _L_inverse(self) -> Array:
        return triangular_inverse(self._L) if len(self._L) else self._L

    def update(self, x: Array, y: float) -> tuple[float, float]:
        """Absorb one sample x (D,), y; returns mean and variance of y, noise included, predicted before.

        Raises DataError for a sample that is not finite, UsageError for the wrong shape, NumericalError where
        sn² is too small; the process is then as it was.
        """
        x, prior_variance = self._checked(x, y)
        a = (
            np.asarray(dtrtrs(self._L, self._point(x, self.basis), lower=1)[0])
            if len(self.basis)
            else self._m
        )
        novelty = max(prior_variance - float(a @ a), 0.0)
        mean = float(a @ self._m)
        variance = novelty + max(float(a @ self._S @ a), 0.0) + self.prior.noise_variance
        if novelty > self.prior.tolerance * prior_variance:
            a = self._append(x, a, novelty, JITTER * prior_variance)
        Sa = self._S @ a
        self._m = self._m + Sa * ((y - mean) / variance)
        self._S = self._S - np.outer(Sa / variance, Sa)
        if len(self._m) > self.prior.capacity:
            self._delete(int(np.argmin(self.scores())))
        self._weights = None
        self.samples += 1
        self._diagonal_sum += prior_variance
        self.log_density -= 0.5 * ((y - mean) ** 2 / variance + float(np.log(2.0 * np.pi * variance)))
        return mean, variance

    def scores(self) -> Array:
        """(u,) alpha²/diag(Q + C): how much the mean would change if that basis point were deleted."""
        T = self._L_inverse
        spread = np.einsum("iu,iu->u", T, dtrmm(1.0, T, self._S, side=1, lower=1))
        return np.asarray((T.T @ self._m) ** 2 / np.maximum(spread, np.finfo(float).tiny))

    def predict(self, X: Array) -> tuple[Array, Array]:
        """Mean (T,) and latent variance (T,) at X (T, D); the prior before the first sample."""
        X = np.asarray(X, dtype=float)
        if X.ndim != 2 or X.shape[1] != self.basis.shape[1]:
            raise UsageError(f"expected inputs of shape (T, {self.basis.shape[1]}), got {X.shape}")
        A = self._whitened(X)
        removed = np.einsum("ut,ut->t", A, A - self._S @ A)
        prior = self.prior.kernel.diagonal(self.prior.theta, X)
        return A.T @ self._m, np.maximum(prior - removed, 0.0)

    def mean(self, x: Array) -> float:
        """Mean at one input x (D,): O(u), after O(u²) if there was an update since."""
        if not len(self.basis):
            return 0.0
        if self._weights is None:
            self._weights = np.asarray(dtrtrs(self._L, self._m, lower=1, trans=1)[0])
        return float(self._point(x, self.basis) @ self._weights)

    def posterior(self) -> BasisPosterior:
        """A copy that later updates leave alone, O(u³); DataError before the first sample."""
        if not self.samples:
            raise DataError("the online process has seen no sample yet")
        values, vectors = np.linalg.eigh(np.eye(len(self._S)) - self._S)
        half = lower_root(values, vectors) @ self._L_inverse
        return BasisPosterior(
            self.prior.kernel,
            self.prior.theta,
            self.prior.noise_variance,
            self._diagonal_sum / self.samples,
            self.basis,
            self.alpha,
            np.asfortranarray(half),
        )

    def _checked(self, x: Array, y: float) -> tuple[Array, float]:
        """The sample's input, and its prior variance."""
        x = np.asarray(x, dtype=float)
        if x.shape != self.basis.shape[1:]:
            raise UsageError(f"expected an input of shape {self.basis.shape[1:]}, got {x.shape}")
        if not (np.isfinite(x).all() and np.isfinite(y)):
            raise DataError("a sample contains NaN or infinite values", next_step="Skip it.")
        prior_variance = float(self._point(x, x[None])[0])
        if not self.prior.noise_variance >= LEAST_NOISE * prior_variance:
            raise NumericalError(
                f"noise variance {self.prior.noise_variance:.1e} is below {LEAST_NOISE:.0e} of the prior "
                f"variance {prior_variance:.1e}, too little for an online process",
                next_step="Set a noise floor.",
            )
        return x, prior_variance

    def _whitened(self, X: Array) -> Array:
        """L^-1 k(basis, X), (u, T)."""
        if not len(self.basis):
            return np.zeros((0, len(X)))
        K = self.prior.kernel.value(self.prior.theta, X, self.basis)
        return np.asarray(dtrtrs(self._L, K.T, lower=1)[0])

    def _append(self, x: Array, a: Array, novelty: float, jitter: float) -> Array:
        """A new basis point: L grows by a row, z by a coordinate N(0, 1); returns cov(z, f(x)) (u + 1,)."""
        deviation = np.sqrt(novelty + jitter)
        row = np.append(a, deviation)
        self.basis = np.vstack([self.basis, x])
        self._L = np.vstack([np.pad(self._L, ((0, 0), (0, 1))), row])
        self._S = np.pad(self._S, (0, 1))
        self._S[-1, -1] = 1.0
        self._m = np.append(self._m, 0.0)
        return np.append(a, novelty / deviation)

    def _delete(self, i: int) -> None:
        """Remove basis point i, O(u²).

        Rotations G make L without row i triangular again, its last column zero, and turn z into Gᵀ z, whose
        last coordinate only the deleted point depends on. (A) leaves it out of N(m, S), (B) sets it to zero.
        """
        first_row = np.zeros_like(self._S)
        first_row[0] = self._m
        m = _rotated(first_row, self._L, i)[0][0]
        half, R = _rotated(self._S, self._L, i)
        S, _ = _rotated(half.T, self._L, i)
        last = S[-1]
        if self.prior.deletion == "B":
            m, S = m - last * (m[-1] / last[-1]), S - np.outer(last / last[-1], last)
        self.basis = np.delete(self.basis, i, axis=0)
        self._L, self._S, self._m = R[:-1].T, 0.5 * (S + S.T)[:-1, :-1], m[:-1]


def _rotated(M: Array, L: Array, i: int) -> tuple[Array, Array]:
    """M G and R (u, u - 1), where L without row i is Rᵀ G⁻¹ and R is upper triangular, its last row zero."""
    turned, R = qr_delete(M, L.T, i, which="col", check_finite=False)
    return np.asarray(turned), np.asarray(R)
