"""How far a prediction is trusted: by its own variance, by what it was trained on, beside a safe command."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.contracts import Array, Column, Mask

# Predicted over prior variance between which trust in a model goes from 1 to 0. Below half the model has
# learnt more than it has left to learn; from 0.9 on it knows no more than before its first trajectory.
TRUSTED, UNKNOWN = 0.5, 0.9
LEAST = 1e-12
"""Least prior deviation, command units: where nothing was to be learned, the safe command is the mean."""
REACH = 0.25
"""Part of an input's range beyond which an uncalibrated model is not asked."""


def trust(variance: Array, prior_deviation: Array) -> Array:
    """Weight (T, J) of a model's mean: 1 where its variance (T, J) is small against the prior's (J,), else 0.

    A quintic step, so a feedforward along a smooth trajectory has no jumps in its first two derivatives.

    An arm's variances come without noise, at rest too (`LearnedModel.faded`): nothing can be learned of it,
    and beside physics, which leave little to learn, it would hide what was.
    """
    ratio = variance / np.maximum(prior_deviation, LEAST) ** 2
    return 1.0 - smoothstep(np.clip((ratio - TRUSTED) / (UNKNOWN - TRUSTED), 0.0, 1.0))


def trusted(mean: Array, variance: Array, prior_deviation: Array, safe: Array) -> Array:
    """Commands (T, J): the mean where it is trusted, blended with the safe command elsewhere."""
    return np.asarray(safe + trust(variance, prior_deviation) * (mean - safe))


def outside(X: Array, columns: Sequence[Column], ranges: Array) -> Mask:
    """(T, S) where each state, an input (T, D) that is a channel itself, is outside the ranges (2, D) trained
    on: the model extrapolates. Exported code says so by a flag.
    """
    own = [i for i, column in enumerate(columns) if not column[3]]
    low, high = ranges[:, own]
    return np.asarray((X[:, own] < low) | (X[:, own] > high))


def familiar(X: Array, ranges: Array) -> Array:
    """(T,) 1 where inputs X (T, D) are within the ranges (2, D) trained on, 0 from a further REACH on."""
    low, high = ranges
    beyond = np.maximum(np.maximum(low - X, X - high), 0.0) / np.maximum(high - low, np.finfo(float).tiny)
    return np.asarray(1.0 - smoothstep(np.clip(beyond.max(axis=1) / REACH, 0.0, 1.0)))


def smoothstep(s: Array) -> Array:
    """From 0 at s = 0 to 1 at s = 1, flat to the second derivative at both ends."""
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s**2))
