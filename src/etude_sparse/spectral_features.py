"""The features of a sparse spectrum: cosines and sines of projections of the inputs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.types import Array


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
    One transcendental instead of two, and of the three the only one NumPy computes several at a time:
    measured 5 ms instead of 32 ms for 3000 x 200, a third of a likelihood with its gradient.
    """
    phases *= 0.5
    t = np.tan(phases, out=phases)
    np.multiply(t, t, out=cosine)
    np.divide(2.0, 1.0 + cosine, out=cosine)
    np.multiply(t, cosine, out=sine)
    cosine -= 1.0
