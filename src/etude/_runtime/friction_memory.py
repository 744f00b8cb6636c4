"""Memory of friction: Dahl's law in displacement (Dahl 1968), row by row without a loop.

Two successive steps of a linear recursion combine to one, so the rows are joined in pairs, fours, eights:
whole arrays at a time. A compiled loop would cost the next proposal more than all other computations, because
the compiler must be loaded.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def dahl(steps: Array, distances: Array, start: Array | float = 0.0) -> Array:
    """Friction (T, ...) in [-1, 1]: it approaches the direction of each step, by 1 - 1/e over the distance.

    Args:
        steps: (T, ...) rad or m, from row to row. distances: (...) rad or m.
        start: (...) before the first row.
    """
    faded = np.exp(-np.abs(steps) / distances)
    values = np.sign(steps) * (1.0 - faded)
    values[0] += faded[0] * start
    return recursion(faded, values)


def recursion(factor: Array, values: Array) -> Array:
    """(T, ...) s <- factor s + value from 0, in the memory of `values`; `factor` is overwritten, too."""
    step = 1
    while step < len(values):
        values[step:] += factor[step:] * values[:-step]
        factor[step:] *= factor[:-step].copy()
        step *= 2
    return values
