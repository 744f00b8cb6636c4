"""Rank-1 updates of a matrix and of its Cholesky factor, compiled; by rotations, as stable as factorising."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


def _compile(function: Any) -> Any:
    """`njit`, cached on disk; where no folder is writable numba raises, and the cache is done without."""
    try:
        return njit(cache=True)(function)
    except RuntimeError:
        return njit(function)


@_compile
def add_outer_product(A: Array, x: Array, forgetting: float) -> None:
    """The upper triangle of A (q, q), C order, becomes that of forgetting A + x xᵀ, in place."""
    for k in range(len(x)):
        for j in range(k, len(x)):
            A[k, j] = forgetting * A[k, j] + x[k] * x[j]


@_compile
def rank_one_update(R: Array, x: Array, forgetting: float) -> None:
    """R (q, q) becomes the factor of forgetting RᵀR + x xᵀ, in place, forgetting > 0; x (q,) is overwritten.

    R is upper triangular in C order, so that the rotations run along rows.
    """
    scale = np.sqrt(forgetting)
    for k in range(len(x)):
        if x[k] == 0.0 and scale == 1.0:
            continue
        old = scale * R[k, k]
        new = np.hypot(old, x[k])
        c, s = old / new, x[k] / new
        R[k, k] = new
        for j in range(k + 1, len(x)):
            r = scale * R[k, j]
            R[k, j] = c * r + s * x[j]
            x[j] = c * x[j] - s * r
