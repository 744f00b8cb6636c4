"""All samples through a few of them as fixed inducing inputs (Titsias 2009), with hyperparameters as given.

Nothing is optimised, so a fold is left out in closed form. With V = L^-1 K_uf Λ^-1/2 and A = I + V Vᵀ, Λ the
samples' noise, samples F go out of A by Woodbury's identity with the small matrix I - V_Fᵀ A^-1 V_F.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from etude.models.gp.basis_posterior import BasisPosterior
from etude.models.gp.cholesky import factorise, triangular_inverse
from etude.models.gp.exact import ExactGP
from etude.models.gp.kernels import mean_signal, rest_variance
from etude.protocols import Posterior
from etude.threads import threads_for
from etude.types import Array, Index

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
        """(u, u) inverse of the Cholesky factor of the covariance at Z, which no sample's own noise is in."""
        K = np.asfortranarray(self.gp.kernel.value(self.gp.theta, self.Z, self.Z))
        L, _ = factorise(K, JITTER * float(K.diagonal().mean()), announce=False)
        return triangular_inverse(L)

    @cached_property
    def roots(self) -> Array:
        """(n,) root of each sample's noise: s², and what friction holds at rest."""
        rest = rest_variance(self.gp.kernel, self.gp.theta, self.X)
        return np.asarray(np.sqrt(self.gp.noise_variance + rest))

    @cached_property
    def V(self) -> Array:
        """(u, n) L^-1 k(Z, X), each sample in deviations of its noise."""
        return np.asarray(self.L_inverse @ self.gp.kernel.value(self.gp.theta, self.Z, self.X) / self.roots)

    @cached_property
    def root_inverse(self) -> Array:
        """(u, u) inverse of the Cholesky factor of A = I + V Vᵀ."""
        root, _ = factorise(np.asfortranarray(self.V @ self.V.T), 1.0, announce=False)
        return triangular_inverse(root)

    def posterior(self, y: Array) -> BasisPosterior:
        """Given y (n,)."""
        gp = self.gp
        with threads_for(len(self.Z)):
            beta = self._solved(self.V @ (y / self.roots))
            middle = -(self.root_inverse.T @ self.root_inverse)  # I - A^-1, its rows and columns reversed
            middle[np.diag_indices_from(middle)] += 1.0
            upper, _ = factorise(np.asfortranarray(middle[::-1, ::-1]), ROUNDING, announce=False)
            half = np.asfortranarray(upper.T[::-1, ::-1] @ self.L_inverse)
            signal = mean_signal(gp.kernel, gp.theta, self.X)
            weights = self.L_inverse.T @ beta
        return BasisPosterior(gp.kernel, gp.theta, gp.noise_variance, signal, self.Z, weights, half)

    def held_out(self, y: Array, out: Index, at: Array) -> tuple[Array, Array]:
        """Means and variances with noise (k,) at inputs (k, D), from the samples that are not in `out`."""
        gp, scaled = self.gp, y / self.roots
        V = self.L_inverse @ gp.kernel.value(gp.theta, self.Z, at)
        with threads_for(len(self.Z)):
            fold, here = self.root_inverse @ self.V[:, out], self.root_inverse @ V
            told = self.root_inverse @ (self.V @ scaled - self.V[:, out] @ scaled[out])
            back = np.zeros((0, len(self.Z)))
            if len(out):
                left, _ = factorise(np.asfortranarray(-(fold.T @ fold)), 1.0, announce=False)
                back = triangular_inverse(left) @ fold.T
            lost, missing = back @ here, gp.kernel.diagonal(gp.theta, at) - np.einsum("un,un->n", V, V)
            mean = here.T @ told + lost.T @ (back @ told)
        spread = np.einsum("un,un->n", here, here) + np.einsum("kn,kn->n", lost, lost)
        return mean, np.maximum(missing, 0.0) + spread + gp.noise_variance

    def _solved(self, b: Array) -> Array:
        return np.asarray(self.root_inverse.T @ (self.root_inverse @ b))


@dataclass(frozen=True, eq=False)
class Induced:
    """How outputs are conditioned (a `process.Condition`), and held out without learning again.

    Attributes:
        gp: with its hyperparameters. Z: (u, D) inducing inputs. X: (n, D) samples that teach.
        taught: (n,) their positions. fold: of every sample, what it is held out with.
    """

    gp: ExactGP
    Z: Array
    X: Array
    taught: Index
    fold: Index

    def __call__(self, X: Array, Y: Array) -> tuple[Posterior, ...]:
        """A posterior for each output (n, m)."""
        seen = _seen(self) if X.shape == self.X.shape else FixedInducing(self.gp, self.Z, X)
        return tuple(seen.posterior(np.ascontiguousarray(y)) for y in Y.T)

    def held_out(self, own: Array, fold: Index, Y: Array) -> tuple[Array, Array]:
        """Means and variances with noise (k, m) at inputs own (k, D) from the samples of other folds.

        Args:
            fold: numbers of those left out. Y: (N, m) outputs of every sample.
        """
        out = np.flatnonzero(np.isin(self.fold[self.taught], fold))
        pairs = [_seen(self).held_out(y, out, own) for y in np.ascontiguousarray(Y[self.taught].T)]
        return np.stack([mean for mean, _ in pairs], axis=1), np.stack([v for _, v in pairs], axis=1)


@lru_cache(maxsize=1)
def _seen(induced: Induced) -> FixedInducing:
    """What all its folds share: tens of megabytes, so only the latest stays."""
    return FixedInducing(induced.gp, induced.Z, induced.X)
