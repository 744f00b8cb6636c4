"""Trust in a prediction: by its own variance, by the training data, beside a safe command.

Both questions are asked of one quantity, what is unknown of a command at an input: its predicted variance
without noise, at rest too (`LearnedModel.unknown`). Every door asks them here: Python, `etude predict`, C,
ONNX, on line.
"""

from __future__ import annotations

import numpy as np

from etude.types import Array, Mask

# Predicted over prior variance between which trust in a model goes from 1 to 0. Below half the model has
# learnt more than it has left to learn; from 0.9 on it knows no more than before its first trajectory.
TRUSTED, UNKNOWN = 0.5, 0.9
NEVER = 1e30
"""Variance that none exceeds, in float too: of commands that nothing says to be outside."""
WIDER = 1.1
"""Least part by which what is unknown grows from full trust to none."""
LEAST_DEVIATION = 1e-12
"""Least prior deviation, command units: where nothing was to be learned, the safe command is the mean."""
OUTSIDE = 2.0
"""Deviation over that of training from which a row lies outside of what a command was learned from."""
ROUNDING = 1e-9
"""Part by which a deviation must exceed that: rounding does not decide where it is the same everywhere."""
REACH = 0.25
"""Part of an input's range beyond which an uncalibrated model is not asked."""


def thresholds(signal_deviation: Array, known: Array | float = 0.0) -> tuple[Array, Array]:
    """(J,) what may be unknown of each command under full trust, and from where on there is none.

    Args:
        signal_deviation: (J,) of what was to be learned. known: (J,) of `known_in_training`: what lies inside
            of what was learned is as good as its data, though noise hides much of a small signal. Where less
            than that is unknown everywhere, a process adds no more than twice the deviation of training.
    """
    signal = np.maximum(signal_deviation, LEAST_DEVIATION) ** 2
    full = np.maximum(TRUSTED * signal, np.minimum(np.asarray(known) * (1.0 + ROUNDING), NEVER))
    return full, np.maximum(UNKNOWN * signal, WIDER * full)


def trust(unknown: Array, signal_deviation: Array, known: Array | float = 0.0) -> Array:
    """Weight (T, J) of a model's mean: 1 where what is unknown (T, J) is small against what was to be
    learned, of deviation (J,), or the row not outside, else 0; see `thresholds`.

    A quintic step, so a feedforward along a smooth trajectory has no jumps in its first two derivatives.

    An arm's variances come without noise, at rest too: nothing can be learned of it, and beside physics,
    which leave little to learn, it would hide what was.
    """
    full, none = thresholds(signal_deviation, known)
    return 1.0 - smoothstep(np.clip((unknown - full) / (none - full), 0.0, 1.0))


def trusted(
    mean: Array, unknown: Array, signal_deviation: Array, safe: Array, known: Array | float = 0.0
) -> Array:
    """Commands (T, J): the mean where it is trusted, blended with the safe command elsewhere.

    Where nothing of the mean is trusted it may be no number at all.
    """
    part = trust(unknown, signal_deviation, known)
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(np.where(part > 0.0, safe + part * (mean - safe), safe))


def known_in_training(unknown: Array, noise: Array) -> Array:
    """(J,) what may be unknown of each command before a row lies outside.

    Args:
        unknown: (J,) mean of what is unknown at inputs trained on. noise: (J,) variance of a sample's noise.

    A deviation, noise included, is then `OUTSIDE` times that of training: u + noise = OUTSIDE^2 (unknown +
    noise).
    """
    return np.asarray(OUTSIDE**2 * (unknown + noise) - noise)


def outside(unknown: Array, known: Array) -> Mask:
    """(T, J) where a row is outside of what a command was learned from; known of `known_in_training`."""
    return np.asarray(~(unknown <= known * (1.0 + ROUNDING)))


def training_range_weight(X: Array, ranges: Array) -> Array:
    """(T,) 1 where inputs X (T, D) are within the ranges (2, D) trained on, 0 from a further REACH on."""
    low, high = ranges
    beyond = np.maximum(np.maximum(low - X, X - high), 0.0) / np.maximum(high - low, np.finfo(float).tiny)
    return np.asarray(1.0 - smoothstep(np.clip(beyond.max(axis=1) / REACH, 0.0, 1.0)))


def smoothstep(s: Array) -> Array:
    """From 0 at s = 0 to 1 at s = 1, flat to the second derivative at both ends."""
    # the one quintic with these ends
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s**2))
