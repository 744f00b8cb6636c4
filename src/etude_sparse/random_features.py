"""Random features of kernels made of squared exponentials and linear parts, as a linear model.

Rahimi and Recht 2007. A squared exponential becomes cosines and sines at frequencies drawn from its
spectrum, a linear part its own columns, a product the products of both; all weights are N(0, 1). What I-SSGPR
(`incremental_spectrum`) is for one squared exponential, it then is for a sum of terms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from etude.errors import UsageError
from etude.models.gp.kernels import Kernel
from etude.models.gp.single_point import kernel_terms
from etude.types import Array, Index
from etude_sparse.spectral_posterior import cosine_sine

PER_INPUT = 10
"""Frequencies of a term for each input that it depends on, until the most allowed are reached."""


@dataclass(frozen=True, eq=False)
class RandomFeatures:
    """phi (n, size) with phi(x)·phi(z) close to k(x, z); see `random_features`.

    Feature k is scale_k times entry wave_k of [1, cos(Ωx), sin(Ωx)] times entry line_k of [1, x].

    Attributes:
        frequencies: Ω (M, D), of all terms.
        wave, line: (size,) positions. scale: (size,).
    """

    frequencies: Array
    wave: Index
    line: Index
    scale: Array

    @property
    def inputs(self) -> int:
        """D."""
        return int(self.frequencies.shape[1])

    @property
    def size(self) -> int:
        """Number of features."""
        return len(self.scale)

    def transform(self, X: Array) -> Array:
        """phi (n, size) at X (n, D)."""
        m = len(self.frequencies)
        waves = np.ones((len(X), 1 + 2 * m))
        cosine_sine(X @ self.frequencies.T, waves[:, 1 : 1 + m], waves[:, 1 + m :])
        lines = np.concatenate([np.ones((len(X), 1)), X], axis=1)
        return np.asarray(self.scale * waves[:, self.wave] * lines[:, self.line])


def random_features(
    kernel: Kernel, theta: Array, inputs: int, most: int, rng: np.random.Generator
) -> RandomFeatures:
    """Features of `kernel` with log hyperparameters theta (P,) on D = `inputs` inputs.

    Every squared exponential gets `PER_INPUT` frequencies for each of its inputs, at most `most`: drawn from
    the normal distribution in equally likely strata along each input, so that few serve a term of one input.

    Raises:
        UsageError: `most` below 1, or a kernel with other parts.
    """
    if most < 1:
        raise UsageError(f"at least one frequency is needed, got {most}")
    terms = kernel_terms(kernel, theta, inputs)
    counts = [
        min(most, PER_INPUT * int(np.count_nonzero(curve))) if curved else 0
        for curve, curved in zip(terms.curve, terms.curved, strict=True)
    ]
    total, first = sum(counts), 1
    places, scales = [], []
    for s, m in enumerate(counts):
        indices = first + np.arange(m)
        waves = np.concatenate([indices, indices + total]) if m else np.zeros(1, dtype=np.int64)
        active = np.flatnonzero(terms.slope[s])
        lines = active + 1 if terms.linear[s] else np.zeros(1, dtype=np.int64)
        slopes = np.sqrt(terms.slope[s, active]) if terms.linear[s] else np.ones(1)
        places.append(np.stack(np.meshgrid(waves, lines, indexing="ij")).reshape(2, -1))
        amplitude = np.sqrt(np.exp(terms.log_variance[s]) / max(m, 1))
        scales.append(np.tile(amplitude * slopes, len(waves)))
        first += m
    frequencies = [
        _stratified(m, inputs, rng) * np.sqrt(curve) for m, curve in zip(counts, terms.curve, strict=True)
    ]
    wave, line = np.concatenate(places, axis=1)
    return RandomFeatures(np.concatenate(frequencies), wave, line, np.concatenate(scales))


def _stratified(count: int, inputs: int, rng: np.random.Generator) -> Array:
    """(count, inputs) standard normal numbers; along each input, one in each of equally likely strata."""
    strata = rng.permuted(np.tile(np.arange(count)[:, None], (1, inputs)), axis=0)
    return np.asarray(ndtri((strata + rng.uniform(size=strata.shape)) / max(count, 1)))


@dataclass(frozen=True, eq=False)
class FeatureProcess:
    """A process with random features and given noise, as `IncrementalSpectrum` takes one.

    Attributes:
        features: phi. noise_variance: sn². signal_variance: scale of k(x, x), to hold the noise against.
    """

    features: RandomFeatures
    noise_variance: float
    signal_variance: float

    @property
    def ridge(self) -> float:
        """Prior precision of a weight times sn²: the weights are N(0, 1)."""
        return self.noise_variance
