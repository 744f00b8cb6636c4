"""Made-up streams of samples for measuring rates and latencies, and a process like a robot's trained ones."""

from __future__ import annotations

import numpy as np

from etude.models import ExactGP, SquaredExponential
from etude.types import Array

INPUTS = 12
PERIOD_S, RATE_HZ = 60.0, 100.0
LENGTH = 2.0
"""Length scales, in deviations of the inputs: as trained ones on a robot's features."""
NOISE = 1e-2
"""Noise variance, in signal variances."""


def process(noise: float) -> ExactGP:
    """A process of unit variance with that noise variance, and lengths as a robot's trained ones."""
    theta = np.concatenate([[0.0], np.full(INPUTS, np.log(LENGTH))])
    return ExactGP(SquaredExponential(tuple(range(INPUTS))), theta, 0.5 * float(np.log(noise)))


def motions(count: int, rng: np.random.Generator) -> Array:
    """(count * 6000, INPUTS) of random Fourier series with three harmonics at 100 Hz."""
    samples = int(PERIOD_S * RATE_HZ)
    phase = 2.0 * np.pi / samples * np.arange(samples)[:, None] * np.arange(1, 4)
    waves = np.concatenate([np.sin(phase), np.cos(phase)], axis=1) / np.sqrt(3.0)
    return np.concatenate([waves @ rng.normal(size=(6, INPUTS)) for _ in range(count)])


def outputs(X: Array, rng: np.random.Generator) -> Array:
    """(n,) noisy outputs at X (n, INPUTS)."""
    return np.asarray(np.sin(X[:, 0]) + X[:, 1] * X[:, 2] + 0.05 * rng.normal(size=len(X)))
