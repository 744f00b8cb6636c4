"""Did a change come at once or little by little? A step and a ramp, fitted to the errors of several logs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from etude.types import Array

BLOCK_S = 10.0
"""s of motion that make one figure: errors within it are alike."""
LEAST_LOGS = 3
"""Fewer show no drift: within a log the motion changes as much as the robot."""
SMOOTHER = 0.7
"""Most that a ramp may leave of what a step leaves, to be believed."""

Manner = Literal["at once", "little by little", "cannot tell"]


def manner(sizes: Sequence[Array]) -> Manner:
    """How a change came.

    Args:
        sizes: of each log, oldest first, (B,) root mean squares of the errors over their predicted deviations
            in blocks of `BLOCK_S`.
    """
    if len(sizes) < LEAST_LOGS:
        return "cannot tell"
    r = np.concatenate(sizes)
    i = np.arange(len(r), dtype=float)
    step = min(_left(r, (i >= at).astype(float)) for at in range(1, len(r)))
    ramps = [_left(r, np.maximum(i - at, 0.0), rising=True) for at in range(len(r) - 2)]
    return "little by little" if min(ramps) <= SMOOTHER * step else "at once"


def block_sizes(t: Array, z: Array) -> Array:
    """(B,) root mean squares of z (n, J), NaN where it says nothing, in blocks of `BLOCK_S` of t (n,) s."""
    finite = np.isfinite(z)
    known = finite.any(axis=1)
    squares = np.where(finite, z, 0.0) ** 2
    mean = squares.sum(axis=1) / np.maximum(finite.sum(axis=1), 1)
    block = ((t - t[0]) / BLOCK_S).astype(np.int64)[known] if len(t) else np.zeros(0, dtype=np.int64)
    return np.array([np.sqrt(mean[known][block == b].mean()) for b in np.unique(block)])


def _left(r: Array, feature: Array, *, rising: bool = False) -> float:
    """Squares of r (n,) about a constant and so much of the feature; infinite where that falls."""
    columns = np.column_stack([np.ones_like(r), feature])
    found = np.linalg.lstsq(columns, r, rcond=None)[0]
    return np.inf if rising and found[1] <= 0.0 else float(np.sum((r - columns @ found) ** 2))
