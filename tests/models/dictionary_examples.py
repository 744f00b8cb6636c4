"""Data and an oracle for the dictionary tests: neighbouring samples of smooth motion, and plain inverses."""

from __future__ import annotations

import numpy as np

from etude.models import ExactGP, SquaredExponential
from etude_sparse import DictionaryConfig


def process(inputs: int, noise_variance: float, length: float = 2.0) -> ExactGP:
    """Signal variance 1."""
    theta = np.concatenate([[0.0], np.full(inputs, np.log(length))])
    log_noise = 0.5 * np.log(noise_variance) if noise_variance else -60.0
    return ExactGP(SquaredExponential(tuple(range(inputs))), theta, float(log_noise))


def motion(rng: np.random.Generator, samples: int, inputs: int, rate: float = 100.0) -> np.ndarray:
    """(samples, inputs) of a random Fourier series, three harmonics of 60 s: near-duplicate neighbours."""
    phase = 2.0 * np.pi / 60.0 * np.arange(samples)[:, None] / rate * np.arange(1, 4)
    return np.sin(phase) @ rng.normal(size=(3, inputs)) + np.cos(phase) @ rng.normal(size=(3, inputs))


def outputs(X: np.ndarray, rng: np.random.Generator, noise: float = 0.05) -> np.ndarray:
    return np.sin(X[:, 0]) + 0.3 * X[:, 1] * X[:, -1] + noise * rng.normal(size=len(X))


def worth(config: DictionaryConfig, error: np.ndarray, variance: np.ndarray, diagonal: float) -> np.ndarray:
    if config.rule == "variance":
        return variance
    if config.guard is None:
        return np.abs(error)
    latent = variance - diagonal
    z2 = error**2 / variance
    inside = np.where(z2 <= config.guard**2, z2, config.guard**4 / np.maximum(z2, 1e-300))
    return latent * (1.0 + inside * latent / variance)


def chosen_by_inverses(
    gp: ExactGP, config: DictionaryConfig, X: np.ndarray, y: np.ndarray, diagonal: float
) -> list[int]:
    """The members of a dictionary, slot by slot, with a matrix inverted anew for every number it needs."""

    def given(members: list[int], x: int) -> tuple[float, float]:
        if not members:
            return float(y[x]), float(gp.kernel.diagonal(gp.theta, X[[x]])[0]) + diagonal
        A = gp.kernel.value(gp.theta, X[members], X[members]) + diagonal * np.eye(len(members))
        k = gp.kernel.value(gp.theta, X[[x]], X[members])[0]
        weights = np.linalg.solve(A, k)
        return float(y[x] - weights @ y[members]), float(
            gp.kernel.diagonal(gp.theta, X[[x]])[0] + diagonal - k @ weights
        )

    kept: list[int] = []
    for x in range(len(y)):
        error, variance = given(kept, x)
        new = np.sqrt(max(variance - diagonal, 0.0)) if config.rule == "variance" else abs(error)
        if new < config.threshold:
            continue
        if len(kept) < config.size:
            kept.append(x)
            continue
        others = [given([m for m in kept if m != i], i) for i in kept]
        scores = worth(config, *np.array(others).T, diagonal)
        if config.half_life is not None:
            scores *= 0.5 ** ((x - np.array(kept)) / config.half_life)
        weakest = int(np.argmin(scores))
        remaining, without = given([m for m in kept if m != kept[weakest]], x)
        bare = config.rule == "error" and config.guard is None
        candidate = worth(config, np.array(error if bare else remaining), np.array(without), diagonal)
        if candidate > scores[weakest] * (1.0 + config.gain):
            kept[weakest] = x
    return kept
