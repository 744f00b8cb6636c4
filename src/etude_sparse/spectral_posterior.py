"""A sparse spectrum process conditioned on data: features, weights, and its export to C99 and ONNX."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from etude._runtime.operators import QUARTER
from etude.errors import UsageError
from etude.models.gp.bayesian_linear import LinearFactors
from etude.models.gp.c99 import BLOCK, EXPONENTIAL, packed
from etude.models.gp.cholesky import triangular_inverse
from etude.models.gp.kernels import SquaredExponential
from etude.threads import threads_for
from etude.types import Array, Code


@dataclass(frozen=True, eq=False)
class SpectralFeatures:
    """phi(x) = [cos ω_1ᵀx .. cos ω_mᵀx, sin ω_1ᵀx .. sin ω_mᵀx], thesis 2.4.

    Attributes:
        frequencies: (m, D) angular frequencies ω, radians per unit of each input.
    """

    frequencies: Array

    @property
    def inputs(self) -> int:
        """D."""
        return int(self.frequencies.shape[1])

    @property
    def size(self) -> int:
        """Number 2m of features."""
        return 2 * len(self.frequencies)

    def transform(self, X: Array) -> Array:
        """phi (n, 2m) at X (n, D)."""
        m = len(self.frequencies)
        P = np.empty((len(X), 2 * m))
        cosine_sine(X @ self.frequencies.T, P[:, :m], P[:, m:])
        return P

    def pullback(self, X: Array, G: Array) -> Array:
        """Gradient (n, D) of sum(G * transform(X)) with respect to X; G is (n, 2m)."""
        return np.asarray(in_phases(self.transform(X), G) @ self.frequencies)


def in_phases(P: Array, G: Array) -> Array:
    """Gradient (n, m) of sum(G * P) with respect to the phases ω_rᵀx; P and G are (n, 2m)."""
    m = P.shape[1] // 2
    gradient = G[:, m:] * P[:, :m]
    gradient -= G[:, :m] * P[:, m:]
    return gradient


def cosine_sine(phases: Array, cosine: Array, sine: Array) -> None:
    """Cosines and sines of `phases` into the arrays given; `phases` is overwritten.

    From t = tan(phase/2): cos = (1 - t²)/(1 + t²) and sin = 2t/(1 + t²), exact to a few roundings everywhere.
    One transcendental instead of two, and the only one of the three that NumPy vectorises. Measured: 5 ms
    instead of 32 ms for 3000 x 200, a third of a likelihood with its gradient.
    """
    phases *= 0.5
    t = np.tan(phases, out=phases)
    np.multiply(t, t, out=cosine)
    np.divide(2.0, 1.0 + cosine, out=cosine)
    np.multiply(t, cosine, out=sine)
    cosine -= 1.0


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

        return spectrum(name, self.frequencies, self.weights, self.root.T)

    def onnx_moments(
        self, graph: Any, x: str, own: Sequence[SparseSpectrumPosterior], variance: bool
    ) -> tuple[str, str]:
        """As `SupportsOnnx.onnx_moments`."""

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

    def _inputs(self, X: Array) -> Array:
        X = np.asarray(X, dtype=float)
        dimensions = self.features.frequencies.shape[1]
        if X.ndim != 2 or X.shape[1] != dimensions:
            raise UsageError(f"expected inputs of shape (T, {dimensions}), got {X.shape}")
        return X


def spectrum(name: str, frequencies: Array, weights: Array, factor: Array | None) -> Code:
    """Mean φ(x)ᵀ w and latent variance |A φ(x)|² of cosines and sines.

    Args:
        frequencies: (m, D). weights: (2m,). factor: (2m, 2m) lower triangular A.
    """
    m, D = frequencies.shape
    size = -(-m // BLOCK) * BLOCK
    places = np.concatenate([np.arange(m), size + np.arange(m)])
    spread = np.zeros(2 * size)
    spread[places] = weights
    W = np.zeros((D, size))
    W[:, :m] = frequencies.T
    data = {f"{name}_w{d}": W[d] for d in range(D)} | {f"{name}_weights": spread}
    variance = {}
    if factor is not None:
        whole = np.zeros((2 * size, 2 * size))
        whole[np.ix_(places, places)] = factor
        variance[f"{name}_factor"] = packed(whole)
    phase = " + ".join(f"x[{d}] * {name}_w{d}[i]" for d in range(D))
    body = f"""static void {name}(const real *x, real *mean, real *variance)
{{
    real phi[{2 * size}], sums[BLOCK] = {{R(0.0)}};
    int first, i;
    for (i = 0; i < {size}; ++i)
        phi[i] = {phase};
    cosines_sines(phi, phi + {size}, {size});
    for (first = 0; first < {2 * size}; first += BLOCK)
        for (i = 0; i < BLOCK; ++i)
            sums[i] += {name}_weights[first + i] * phi[first + i];
    mean[0] = total(sums);
#if VARIANCE
    if (variance)
        variance[0] = squared({name}_factor, phi, {2 * size}, R(1.0e30));
#else
    (void)variance;
#endif
}}
"""
    operations = size * (2 * D + 3 * EXPONENTIAL // 2 + 4)
    return Code(body, data, variance, work=2 * size + BLOCK, operations=(operations, 4 * size * size))


def spectral_graph(graph: Any, x: str, posteriors: Sequence[Any], variance: bool) -> tuple[str, str]:
    """Means and latent variances (n, m) of posteriors with as many frequencies each; "" if not requested.

    Args:
        graph: a `deploy.targets.onnx.model_graph.Graph`. posteriors: `SparseSpectrumPosterior`s.
        x: (n, D) inputs in the graph.
    """
    phases = graph.op("MatMul", x, np.stack([p.frequencies.T for p in posteriors]))
    cosines = graph.op("Sin", graph.op("Add", phases, QUARTER))
    phi = graph.op("Concat", cosines, graph.op("Sin", phases), axis=2)
    weights = np.stack([p.weights for p in posteriors])[:, None, :]
    mean = graph.op("Transpose", graph.total(graph.op("Mul", phi, weights), -1), perm=[1, 0])
    if not variance:
        return mean, ""
    half = graph.op("MatMul", phi, np.stack([p.root for p in posteriors]))
    return mean, graph.op("Transpose", graph.total(graph.op("Mul", half, half), -1), perm=[1, 0])
