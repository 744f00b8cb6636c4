"""A sparse spectrum process conditioned on data: a normal distribution over the weights of its features."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from etude.blas import dpotrs
from etude.errors import UsageError
from etude.models.gp.bayesian_linear import LinearFactors
from etude.models.gp.cholesky import factorise, triangular_inverse
from etude.models.gp.kernels import SquaredExponential
from etude.threads import threads_for
from etude.types import Array, Code
from etude_sparse.spectral_features import SpectralFeatures


@dataclass(frozen=True, eq=False)
class SparseSpectrumPosterior:
    """The weights' mean w and covariance sn² A^-1 (implements `protocols.Posterior`). Variances are latent.

    They are those of the sparse spectrum model, which is more certain than the full process it stands for.

    Attributes:
        features: the 2m features. signal_variance: s0².
        noise_variance: sn², with anything that had to be added.
        weights: (2m,) w = A^-1 b. L: (2m, 2m) lower Cholesky factor of A.
        X, y: (n, D) and (n,) what it was conditioned on; n = 0 if that was not kept (learned on line).
        theta: (D + 1,) log s0 and log ℓ_1 .. log ℓ_D: a training can go on from it.
    """

    form: ClassVar[str] = "spectrum"
    features: SpectralFeatures
    signal_variance: float
    noise_variance: float
    weights: Array
    L: Array
    X: Array
    y: Array
    theta: Array

    @property
    def kernel(self) -> SquaredExponential:
        """The covariance function that the spectrum stands for."""
        return SquaredExponential(tuple(range(len(self.theta) - 1)))

    @property
    def frequencies(self) -> Array:
        """(m, D) of the features."""
        return self.features.frequencies

    @property
    def points(self) -> Array:
        """(m, D) spectral points ε = ω ℓ."""
        return np.asarray(self.features.frequencies * np.exp(self.theta[1:]))

    @property
    def columns_read(self) -> frozenset[int]:
        """Every column of the inputs."""
        return frozenset(range(self.features.inputs))

    @property
    def alike(self) -> tuple[int, ...]:
        """Posteriors with frequencies of this shape (m, D) are asked together."""
        return self.frequencies.shape

    def c(self, name: str) -> Code:
        """As C99."""
        from etude_sparse.spectral_export import spectrum

        return spectrum(name, self.frequencies, self.weights, self.root.T)

    def onnx_moments(
        self, graph: Any, x: str, own: Sequence[SparseSpectrumPosterior], variance: bool
    ) -> tuple[str, str]:
        """As `SupportsOnnx.onnx_moments`."""
        from etude_sparse.spectral_export import spectral_graph

        return spectral_graph(graph, x, own, variance)

    @cached_property
    def root(self) -> Array:
        """(2m, 2m) sn L^-ᵀ: root rootᵀ is the weights' covariance."""
        return np.asarray(np.sqrt(self.noise_variance) * triangular_inverse(self.L).T)

    def factors(self, X: Array) -> LinearFactors:
        """What covariances and gradients at X (T, D) share; keep it for inputs that stay."""
        X = self._inputs(X)
        return LinearFactors(self.features, X, self.features.transform(X) @ self.root, self.root)

    def predict(self, X: Array) -> tuple[Array, Array]:
        """Mean (T,) φᵀw and latent variance (T,) sn² φᵀA^-1φ: O(m) and O(m²) a point, thesis 2.4."""
        X = self._inputs(X)
        with threads_for(len(self.weights)):
            P = self.features.transform(X)
            return P @ self.weights, LinearFactors(self.features, X, P @ self.root, self.root).variance()

    def mean(self, X: Array) -> Array:
        """Mean (T,) alone."""
        return np.asarray(self.features.transform(self._inputs(X)) @ self.weights)

    def covariance(self, X: Array, Z: Array) -> Array:
        """Posterior covariance (T, r) of the latent function between X (T, D) and Z (r, D)."""
        with threads_for(len(self.weights)):
            return self.factors(X).covariance(self.factors(Z))

    def covariance_gradient(self, X: Array, Z: Array, G: Array) -> Array:
        """Gradient (T, D) of sum(G * covariance(X, Z)) with respect to X, Z held fixed; G is (T, r)."""
        with threads_for(len(self.weights)):
            return self.factors(X).gradient(cross=(self.factors(Z), G))

    def variance_gradient(self, X: Array, g: Array) -> Array:
        """Gradient (T, D) of sum(g * variance(X)) with respect to X; g is (T,)."""
        with threads_for(len(self.weights)):
            return self.factors(X).gradient(variance=g)

    def mean_gradient(self, X: Array) -> Array:
        """Gradient (T, D) of the mean at each row of X."""
        X = self._inputs(X)
        return self.features.pullback(X, np.broadcast_to(self.weights, (len(X), len(self.weights))))

    def leave_group_out(self, group: NDArray[np.int64]) -> tuple[Array, Array]:
        """Mean (n,) and variance with noise (n,) of each y from the points of the other groups.

        `group` (n,) numbers the trajectory of each point. The points of one group are taken out of A and b:
        one factorisation of order 2m a group, and no second pass over the others.
        """
        group = np.asarray(group)
        if group.shape != self.y.shape:
            raise UsageError(f"one group number per point: {len(self.y)} points, groups {group.shape}")
        mean, variance = np.empty_like(self.y), np.empty_like(self.y)
        with threads_for(len(self.weights)):
            A = self.L @ self.L.T
            b = A @ self.weights
            for number in np.unique(group):
                own = group == number
                P = self.features.transform(self.X[own])
                L, _ = factorise(np.asfortranarray(A - P.T @ P), 0.0)
                half = P @ triangular_inverse(L).T
                mean[own] = P @ dpotrs(L, b - P.T @ self.y[own], lower=1)[0]
                variance[own] = self.noise_variance * (1.0 + np.einsum("tp,tp->t", half, half))
        return mean, variance

    def _inputs(self, X: Array) -> Array:
        X = np.asarray(X, dtype=float)
        dimensions = self.features.frequencies.shape[1]
        if X.ndim != 2 or X.shape[1] != dimensions:
            raise UsageError(f"expected inputs of shape (T, {dimensions}), got {X.shape}")
        return X
