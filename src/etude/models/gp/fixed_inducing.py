"""All samples through a few of them as fixed inducing inputs (Titsias 2009), with hyperparameters as given.

Nothing is optimised, so a fold is left out in closed form: with V = L^-1 K_uf, s² the noise and
H = V_Fᵀ (I + V Vᵀ / s²)^-1 V_F / s², the mean of the fold's samples F is (I - H)^-1 m, m what the rest's sums
alone give, and their covariance s² (I - H)^-1 beside what the inducing inputs cannot express.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dpotrs

from etude.contracts import Array, Index
from etude.models.gp.basis_posterior import BasisPosterior
from etude.models.gp.cholesky import factorise, triangular_inverse
from etude.models.gp.exact import ExactGP
from etude.threads import threads_for

JITTER = 1e-8
"""Part of the mean prior variance at the inducing inputs that is added to their covariance."""
ROUNDING = 1e-10
"""Part of the prior that the posterior's variance may lose to rounding."""


@dataclass(frozen=True, eq=False)
class FixedInducing:
    """A process that sees samples X (n, D) through inducing inputs Z (u, D).

    Attributes:
        gp: kernel, hyperparameters and noise.
    """

    gp: ExactGP
    Z: Array
    X: Array

    @cached_property
    def L_inverse(self) -> Array:
        """(u, u) inverse of the Cholesky factor of the covariance at Z."""
        K, _ = self.gp.kernel.gram(self.gp.theta, self.Z)
        L, _ = factorise(K, JITTER * float(K.diagonal().mean()), announce=False)
        return triangular_inverse(L)

    @cached_property
    def V(self) -> Array:
        """(u, n) L^-1 k(Z, X)."""
        return np.asarray(self.L_inverse @ self.gp.kernel.value(self.gp.theta, self.Z, self.X))

    @cached_property
    def root_inverse(self) -> Array:
        """(u, u) inverse of the Cholesky factor of A = I + V Vᵀ / s²."""
        root, _ = factorise(
            np.asfortranarray(self.V @ self.V.T / self.gp.noise_variance), 1.0, announce=False
        )
        return triangular_inverse(root)

    def posterior(self, y: Array) -> BasisPosterior:
        """Given y (n,)."""
        with threads_for(len(self.Z)):
            beta = self._solved(self.V @ y) / self.gp.noise_variance
            middle = -(self.root_inverse.T @ self.root_inverse)  # I - A^-1, its rows and columns reversed
            middle[np.diag_indices_from(middle)] += 1.0
            upper, _ = factorise(np.asfortranarray(middle[::-1, ::-1]), ROUNDING, announce=False)
            half = np.asfortranarray(upper.T[::-1, ::-1] @ self.L_inverse)
            signal = float(self.gp.kernel.diagonal(self.gp.theta, self.X).mean())
            weights = self.L_inverse.T @ beta
        gp = self.gp
        return BasisPosterior(gp.kernel, gp.theta, gp.noise_variance, signal, self.Z, weights, half)

    def held_out(self, y: Array, out: Index, at: Index) -> tuple[Array, Array]:
        """Means and variances with noise of the samples `at`, some of `out`, from those that are not in `out`."""
        noise = self.gp.noise_variance
        with threads_for(len(self.Z)):
            V = self.V[:, out]
            half = self.root_inverse @ V
            left = np.eye(len(out)) - half.T @ half / noise
            root, _ = factorise(np.asfortranarray(left), 0.0, announce=False)
            told = V.T @ self._solved(self.V @ y - V @ y[out]) / noise
            mean, _ = dpotrs(root, told, lower=1)
            inverse = triangular_inverse(root)
        own = np.searchsorted(out, at)
        prior = self.gp.kernel.diagonal(self.gp.theta, self.X[at])
        missing = np.maximum(prior - np.einsum("un,un->n", self.V[:, at], self.V[:, at]), 0.0)
        return mean[own], missing + noise * np.einsum("ij,ij->j", inverse, inverse)[own]

    def _solved(self, b: Array) -> Array:
        return np.asarray(self.root_inverse.T @ (self.root_inverse @ b))
