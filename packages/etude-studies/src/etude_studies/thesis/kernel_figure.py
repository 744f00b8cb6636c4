"""The squared exponential and what a draw of spectral points makes of it (figure 2.3).

A draw ω_1 .. ω_m from the kernel's spectrum has the covariance s0²/m Σ cos ω_rᵀ(x1 - x2): unbiased, with a
variance of s0⁴ (1 - exp(-r²))² / 2m at the distance of r lengths.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import polars as pl

from etude.models import SquaredExponential
from etude.types import Array
from etude_sparse import SpectralFeatures
from etude_studies.measured import Measured

POINTS = (5, 10, 20, 50, 100, 200, 500)
DRAWN = (10, 50)
"""Numbers of spectral points; those of which the curve itself is kept."""
INPUTS = {"D1": 1, "D12": 12}
"""As drawn in the thesis, and the inputs of its arm."""
REACH, PAIRS, CURVE = 5.0, 2001, 81
"""Largest distance in lengths; pairs of inputs at which the error is taken, instants of a curve."""


def run(settings: Mapping[str, Any], seed: int, _: Mapping[str, pl.DataFrame]) -> list[Measured]:
    """Root mean square errors of one draw by number of points (k), and the curves of one input.

    Args:
        settings: `points`, other numbers of spectral points than `POINTS`.
        seed: of the draw.
    """
    rows = list[Measured]()
    for part, inputs in INPUTS.items():
        lags = lags_within(inputs, np.random.default_rng([seed, inputs]))
        for count in settings.get("points", POINTS):
            features = drawn(count, inputs, np.random.default_rng([seed, inputs, count]))
            error = covariances(features, lags) - exact(lags)
            rms = float(np.sqrt((error**2).mean()))
            rows.append(Measured(count, "", "", part, "kernel_rms", rms))
    return [*rows, *_curves(seed)]


def _curves(seed: int) -> Iterator[Measured]:
    """Covariance by distance, k the place on the curve."""
    lags = np.linspace(-REACH, REACH, CURVE)[:, None]
    curves = {"exact": exact(lags)}
    for count in DRAWN:
        features = drawn(count, 1, np.random.default_rng([seed, 1, count]))
        curves[f"m{count}"] = covariances(features, lags)
    for place in range(CURVE):
        yield Measured(place, "", "", "D1", "lag", float(lags[place, 0]))
        for name, values in curves.items():
            yield Measured(place, "", name, "D1", "kernel", float(values[place]))


def drawn(count: int, inputs: int, rng: np.random.Generator) -> SpectralFeatures:
    """m = `count` points of the spectrum of the squared exponential whose lengths are 1."""
    return SpectralFeatures(rng.standard_normal((count, inputs)))


def covariances(features: SpectralFeatures, lags: Array) -> Array:
    """(n,) of the features at differences x1 - x2 (n, D) of inputs, s0 = 1."""
    origin = features.transform(np.zeros((1, features.inputs)))[0]
    return np.asarray(features.transform(lags) @ origin / len(features.frequencies))


def exact(lags: Array) -> Array:
    """(n,) of the squared exponential itself, s0 = 1 and lengths 1."""
    inputs = lags.shape[1]
    kernel = SquaredExponential(tuple(range(inputs)))
    return np.asarray(kernel.value(np.zeros(inputs + 1), lags, np.zeros((1, inputs)))[:, 0])


def lags_within(inputs: int, rng: np.random.Generator) -> Array:
    """(n, D) differences of inputs: distances evenly from 0 to 5 lengths, directions at random.

    In one dimension the axis of figure 2.3; its negative half is the positive one, the kernel being even.
    """
    directions = rng.standard_normal((PAIRS, inputs))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return np.asarray(np.linspace(0.0, REACH, PAIRS)[:, None] * directions)
