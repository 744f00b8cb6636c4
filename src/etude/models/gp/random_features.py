"""Random features of any kernel made of squared exponentials and linear parts: its process as a linear model.

Rahimi and Recht 2007. A squared exponential becomes cosines and sines at frequencies drawn from its
spectrum, a linear part its own columns, a product the products of both; all weights are N(0, 1). What I-SSGPR
(`incremental_spectrum`) is for one squared exponential, it then is for a sum of terms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from etude.errors import UsageError
from etude.models.gp.kernels import Kernel
from etude.models.gp.point_kernel import Terms, kernel_terms
from etude.models.gp.spectral_features import cosine_sine

Array = NDArray[np.float64]

PER_INPUT = 10
"""Frequencies of a term for each input that it depends on, until the most allowed are reached."""


@dataclass(frozen=True, eq=False)
class RandomFeatures:
    """phi (n, size) with phi(x)·phi(z) close to k(x, z); see `random_features`.

    Attributes:
        terms: the kernel.
        frequencies: for each term (m, D) angular frequencies; none where it has no squared exponential.
    """

    terms: Terms
    frequencies: tuple[Array, ...]

    @property
    def inputs(self) -> int:
        """D."""
        return int(self.terms.curve.shape[1])

    @property
    def size(self) -> int:
        """Number of features."""
        return sum(
            max(2 * len(own), 1) * (int(np.count_nonzero(slope)) if linear else 1)
            for own, slope, linear in zip(self.frequencies, self.terms.slope, self.terms.linear, strict=True)
        )

    def transform(self, X: Array) -> Array:
        """phi (n, size) at X (n, D)."""
        blocks = []
        for s, frequencies in enumerate(self.frequencies):
            wave = np.ones((len(X), 1))
            m = len(frequencies)
            if m:
                wave = np.empty((len(X), 2 * m))
                cosine_sine(X @ frequencies.T, wave[:, :m], wave[:, m:])
                wave *= np.sqrt(np.exp(self.terms.log_variance[s]) / m)
            if self.terms.linear[s]:
                active = np.flatnonzero(self.terms.slope[s])
                line = X[:, active] * np.sqrt(self.terms.slope[s, active])
                wave = (line[:, :, None] * wave[:, None, :]).reshape(len(X), -1)
            blocks.append(wave)
        return np.concatenate(blocks, axis=1)


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
    frequencies = []
    for curve, curved in zip(terms.curve, terms.curved, strict=True):
        m = min(most, PER_INPUT * int(np.count_nonzero(curve))) if curved else 0
        strata = rng.permuted(np.tile(np.arange(m)[:, None], (1, inputs)), axis=0)
        normal = ndtri((strata + rng.uniform(size=strata.shape)) / max(m, 1))
        frequencies.append(normal * np.sqrt(curve))
    return RandomFeatures(terms, tuple(frequencies))


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
