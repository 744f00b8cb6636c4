"""Posterior covariances of a batch of inputs and their gradients, sharing every factor that can be shared."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dtrmm

from etude.models.kernels import Kernel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CovarianceFactors:
    """What a posterior knows about inputs X (T, D), given its n training points.

    A criterion evaluates the factors of its batch once, reads covariances from them, and hands the weights of
    those covariances back to `gradient`: one triangular product forward and one back, whatever the criterion.

    Attributes:
        K: (T, n) prior covariance between X and the training inputs.
        V: (T, n) K L^-T, so that posterior covariance = prior covariance - V Vᵀ.
    """

    kernel: Kernel
    theta: Array
    L_inverse: Array
    X: Array
    K: Array
    V: Array
    pull: Callable[[Array], Array]

    @classmethod
    def of(
        cls,
        kernel: Kernel,
        theta: Array,
        L_inverse: Array,
        X: Array,
        K: Array,
        pull: Callable[[Array], Array],
    ) -> CovarianceFactors:
        """The factors from the prior covariance K (T, n) with the training inputs and its pull-back."""
        return cls(kernel, theta, L_inverse, X, K, dtrmm(1.0, L_inverse, K.T, lower=1).T, pull)

    def variance(self) -> Array:
        """Latent variance (T,), thesis (2.6); never below zero."""
        prior = self.kernel.diagonal(self.theta, self.X)
        return np.maximum(prior - np.einsum("tn,tn->t", self.V, self.V), 0.0)

    def covariance(self, other: CovarianceFactors | None = None) -> Array:
        """Posterior covariance (T, r) with another set of inputs, or (T, T) with itself."""
        other = self if other is None else other
        prior = self.kernel.value(self.theta, self.X, other.X)
        return np.asarray(prior - self.V @ other.V.T)

    def gradient(
        self,
        *,
        variance: Array | None = None,
        own: Array | None = None,
        cross: tuple[CovarianceFactors, Array] | None = None,
    ) -> Array:
        """Gradient (T, D) with respect to X of the sum of the terms given.

        Args:
            variance: (T,) weights g of sum(g * variance(X)).
            own: (T, T) symmetric weights G of sum(G * covariance(X, X)).
            cross: factors of fixed inputs Z (r, D) and (T, r) weights G of sum(G * covariance(X, Z)).
        """
        back = np.zeros_like(self.V)  # weights on V, before the way back through L
        total = np.zeros_like(self.X)
        if variance is not None:
            back -= 2.0 * variance[:, None] * self.V
            total += self.kernel.diagonal_gradient(self.theta, self.X, variance)
        if own is not None:
            back -= 2.0 * (own @ self.V)
            total += 2.0 * self.kernel.input_gradient(self.theta, self.X, self.X, own)
        if cross is not None:
            other, weights = cross
            back -= weights @ other.V
            total += self.kernel.input_gradient(self.theta, self.X, other.X, weights)
        return total + self.pull(dtrmm(1.0, self.L_inverse, back.T, lower=1, trans_a=1).T)
