"""Rank-1 updates of a matrix and of its Cholesky factor, compiled; by rotations, as stable as factorising."""

from __future__ import annotations

import numpy as np

from etude.compilation import compiled
from etude.types import Array


@compiled
def add_outer_product(A: Array, x: Array, forgetting: float) -> None:
    """The upper triangle of A (q, q), C order, becomes that of forgetting A + x xᵀ, in place."""
    for k in range(len(x)):
        for j in range(k, len(x)):
            A[k, j] = forgetting * A[k, j] + x[k] * x[j]


@compiled
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
