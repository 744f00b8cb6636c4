"""Posterior covariances of a batch of inputs and their gradients, sharing every factor that can be shared."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from etude._runtime.scipy_parts import dgemm, dtrmm
from etude.models.gp.kernel_algebra import Against, Of
from etude.models.gp.kernels import Kernel
from etude.types import Array

VJP = Callable[[Array], Array]
BLOCK = 256
"""Inputs predicted at once: their covariances stay in the processor's cache."""


def blocks(count: int) -> list[slice]:
    """The inputs that are predicted at once."""
    return [slice(first, first + BLOCK) for first in range(0, count, BLOCK)]


def moments(values: Of, weights: Array, lower: Array, X: Array, prior: Array) -> tuple[Array, Array]:
    """Mean K w (T,) and latent variance prior - |R kᵀ|² (T,) at X (T, D), K = values(X) (T, n).

    Args:
        weights: (n,) w. lower: (n, n) R, lower triangular, whose upper half is zero. prior: (T,).
    """
    mean, variance = np.empty(len(X)), prior
    for rows in blocks(len(X)):
        K = values(X[rows])
        mean[rows] = K @ weights
        V = dtrmm(1.0, lower, K.T, lower=1, overwrite_b=1)
        variance[rows] -= np.einsum("nt,nt->t", V, V)
    return mean, np.maximum(variance, 0.0)


@dataclass(frozen=True, eq=False)
class CovarianceFactors:
    """What a posterior knows about inputs X (T, D), given its n training points.

    A criterion evaluates the factors of its batch once, reads covariances from them, and hands the weights of
    those covariances back to `gradient`: one triangular product forward, one back, whatever the criterion.
    Prior covariances read on the way are kept for the way back.

    Attributes:
        K: (T, n) prior covariance between X and the training inputs.
        V: (T, n) K L^-T, so that posterior covariance = prior covariance - V Vᵀ.
        vjp: weights on K -> gradient in X.
    """

    kernel: Kernel
    theta: Array
    L_inverse: Array
    X: Array
    K: Array
    V: Array
    vjp: VJP
    _read: dict[int, tuple[CovarianceFactors | None, Array, VJP]] = field(default_factory=dict, repr=False)

    @classmethod
    def of(
        cls, kernel: Kernel, theta: Array, L_inverse: Array, X: Array, K: Array, vjp: VJP
    ) -> CovarianceFactors:
        """The factors from the prior covariance K (T, n) with the training inputs and its pull-back."""
        V = dtrmm(1.0, L_inverse, K.T, lower=1).T
        return cls(kernel, theta, L_inverse, X, K, V, vjp)

    @cached_property
    def against(self) -> Against:
        """X (T', D) -> prior covariance (T', T) with these inputs, and its pull-back."""
        return self.kernel.against(self.theta, self.X)

    def variance(self) -> Array:
        """Latent variance (T,), thesis (2.6); never below zero."""
        prior = self.kernel.diagonal(self.theta, self.X)
        return np.asarray(np.maximum(prior - np.einsum("tn,tn->t", self.V, self.V), 0.0))

    def covariance(self, other: CovarianceFactors | None = None) -> Array:
        """Posterior covariance (T, r) with another set of inputs, or (T, T) with itself."""
        other = self if other is None else other
        prior, _ = self._prior(other)
        if other is self:
            return np.asarray(prior - self.V @ self.V.T)
        return np.asarray(prior - self.V @ other.V.T)

    def _prior(self, other: CovarianceFactors) -> tuple[Array, VJP]:
        if id(other) not in self._read:
            # another set is kept with its entry, so that its id cannot pass to a third; itself is not: in a
            # circle of references the matrices would wait for the garbage collector
            reference = None if other is self else other
            self._read[id(other)] = (reference, *other.against(self.X))
        _, prior, vjp = self._read[id(other)]
        return prior, vjp

    def gradient(
        self,
        *,
        variance: Array | None = None,
        own: Array | None = None,
        cross: tuple[CovarianceFactors, Array] | None = None,
        reduction: tuple[CovarianceFactors, Array, Array] | None = None,
    ) -> Array:
        """Gradient (T, D) with respect to X of the sum of the terms given.

        Args:
            variance: (T,) weights g of sum(g * variance(X)).
            own: (T, T) symmetric weights G of sum(G * covariance(X, X)).
            cross: factors of fixed inputs Z (r, D) and (T, r) weights G of sum(G * covariance(X, Z)).
            reduction: factors of fixed inputs Z, A and B (T, r) with A Bᵀ symmetric: the same as
                own = -A Bᵀ and cross = 2 A together, the form of every variance reduction at Z, for which
                the way back through L can be r wide instead of T.
        """
        gradient = np.zeros_like(self.X)
        if variance is not None or own is not None or cross is not None:
            gradient += self.vjp(self._back(variance, own, cross))
        if variance is not None:
            gradient += self.kernel.diagonal_gradient(self.theta, self.X, variance)
        if own is not None:
            gradient += 2.0 * self._prior(self)[1](own)
        if cross is not None:
            gradient += self._prior(cross[0])[1](cross[1])
        if reduction is not None:
            other, A, B = reduction
            through_own = A @ B.T
            gradient += self.vjp(self._reduction_back(other, A, B, through_own))
            gradient += 2.0 * (self._prior(other)[1](A) - self._prior(self)[1](through_own))
        return gradient

    def _back(
        self, variance: Array | None, own: Array | None, cross: tuple[CovarianceFactors, Array] | None
    ) -> Array:
        """Weights (T, n) on K: those on V, taken back through L."""
        weights = np.zeros_like(self.V) if own is None else own @ self.V
        if own is not None:
            weights *= -2.0
        if variance is not None:
            weights -= 2.0 * variance[:, None] * self.V
        if cross is not None:
            weights -= cross[1] @ cross[0].V
        return np.asarray(dtrmm(1.0, self.L_inverse, weights.T, lower=1, trans_a=1, overwrite_b=1).T)

    def _reduction_back(self, other: CovarianceFactors, A: Array, B: Array, product: Array) -> Array:
        """-2 A (V_Z - Bᵀ V) L^-1: from the right, or, by product = A Bᵀ, from the left if A is wide."""
        if A.shape[1] > len(A):
            return self._back(None, -product, (other, 2.0 * A))
        left = dgemm(-1.0, self.V.T, B, beta=1.0, c=other.V.T)
        left = dtrmm(1.0, self.L_inverse, left, lower=1, trans_a=1, overwrite_b=1)
        return np.asarray(dgemm(-2.0, left, A, trans_b=1).T)
