"""Posterior of models with a few basis points in place of all data."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from etude.errors import UsageError
from etude.models.gp.covariance_factors import CovarianceFactors, blocks, moments
from etude.models.gp.kernel_algebra import Of
from etude.models.gp.kernels import Kernel
from etude.threads import threads_for
from etude.types import Array


@dataclass(frozen=True, eq=False)
class BasisPosterior:
    """mean(x) = k_u(x)ᵀ w and cov(x, z) = k(x, z) - k_u(x)ᵀ Rᵀ R k_u(z), with k_u(x) = k(basis, x).

    Implements `protocols.Posterior`. O(u) a point for the mean, O(u²) for the variance, whatever number of
    samples taught it. Far from the basis points the prior returns.

    Attributes:
        noise_variance: sn². signal_variance: mean of k(x, x) over the training inputs, without noise at rest.
        basis: (u, D) basis points.
        weights: (u,) w.
        half: (u, u) R, lower triangular.
    """

    form: ClassVar[str] = "basis"
    kernel: Kernel
    theta: Array
    noise_variance: float
    signal_variance: float
    basis: Array
    weights: Array
    half: Array

    @property
    def packed(self) -> Array:
        """(u (u + 1)/2,) the lower half of R, row by row: half of what a file would hold else."""
        return self.half[np.tril_indices(len(self.half))]

    def factors(self, X: Array) -> CovarianceFactors:
        """What covariances and gradients at X (T, D) share; keep it for inputs that stay."""
        X = self._inputs(X)
        K, vjp = self.kernel.cross(self.theta, X, self.basis)
        return CovarianceFactors.of(self.kernel, self.theta, self.half, X, K, vjp)

    def predict(self, X: Array) -> tuple[Array, Array]:
        """Mean (T,) and latent variance (T,) at X (T, D)."""
        X = self._inputs(X)
        with threads_for(len(self.basis)):
            prior = self.kernel.diagonal(self.theta, X)
            return moments(self._values, self.weights, self.half, X, prior)

    @threads_for(0)  # the products are as narrow as the inputs
    def mean(self, X: Array) -> Array:
        """Mean (T,) alone."""
        X = self._inputs(X)
        # one product, as in `predict`: weights are large and cancel, and kernels' sums by parts would round
        return np.concatenate([self._values(X[rows]) @ self.weights for rows in blocks(len(X))] or [X[:, 0]])

    @cached_property
    def _values(self) -> Of:
        return self.kernel.values(self.theta, self.basis)

    def covariance(self, X: Array, Z: Array) -> Array:
        """Posterior covariance (T, r) of the latent function between X (T, D) and Z (r, D)."""
        with threads_for(len(self.basis)):
            return self.factors(X).covariance(self.factors(Z))

    def covariance_gradient(self, X: Array, Z: Array, G: Array) -> Array:
        """Gradient (T, D) of sum(G * covariance(X, Z)) with respect to X, Z held fixed; G is (T, r)."""
        with threads_for(len(self.basis)):
            return self.factors(X).gradient(cross=(self.factors(Z), G))

    def variance_gradient(self, X: Array, g: Array) -> Array:
        """Gradient (T, D) of sum(g * variance(X)) with respect to X; g is (T,)."""
        with threads_for(len(self.basis)):
            return self.factors(X).gradient(variance=g)

    def mean_gradient(self, X: Array) -> Array:
        """Gradient (T, D) of the mean at each row of X."""
        X = self._inputs(X)
        _, vjp = self.kernel.cross(self.theta, X, self.basis)
        return vjp(np.broadcast_to(self.weights, (len(X), len(self.basis))))

    def _inputs(self, X: Array) -> Array:
        X = np.asarray(X, dtype=float)
        if X.ndim != 2 or X.shape[1] != self.basis.shape[1]:
            raise UsageError(f"expected inputs of shape (T, {self.basis.shape[1]}), got {X.shape}")
        return X


def unpacked(packed: Array, u: int) -> Array:
    """R (u, u) of its `BasisPosterior.packed`."""
    half = np.zeros((u, u), order="F")
    half[np.tril_indices(u)] = packed
    return half


def lower_root(values: Array, vectors: Array) -> Array:
    """Lower triangular R (u, u) with Rᵀ R = vectors diag(values) vectorsᵀ; values (u,) below zero count as 0.

    From an eigendecomposition, so that a matrix of deficient rank (fewer samples than basis points) has a
    root too, where a Cholesky factorisation would need something added.
    """
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    # QR of the columns in reverse order is QL: root = Q' R with R lower
    upper = np.asarray(np.linalg.qr(root[:, ::-1], mode="r"))
    return np.asfortranarray(upper[::-1, ::-1])
