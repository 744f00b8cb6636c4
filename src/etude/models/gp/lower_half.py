"""The lower half of symmetric matrices, by panels of columns: what a Cholesky factor and a likelihood read.

A panel is so many columns from their diagonal down. It stays in the processor's second cache from one step to
the next; above the diagonal no more than the panel's own small triangle is computed or read.
Matrices here are (n, n) in Fortran order; above the diagonal they may hold anything.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from etude.types import Array

PANEL = 128
"""Columns handled at once, about: at n = 1000 their half megabyte is in the second cache."""
ALIGNED = 8
"""Panels begin at multiples of so many columns."""


def panels(n: int) -> Iterator[tuple[slice, slice]]:
    """(rows, columns) of the panels of a matrix of order n, from the left, of about the same width."""
    width = -(-n // max(1, round(n / PANEL)))
    width += -width % ALIGNED
    for first in range(0, n, width):
        yield slice(first, n), slice(first, min(first + width, n))


def combined(operation: np.ufunc, terms: Sequence[Array], out: Array) -> Array:
    """Two terms or more added (`np.add`) or multiplied from the left, in `out`, which is given back."""
    for panel in panels(len(out)):
        so_far, part = terms[0][panel], out[panel]
        for term in terms[1:]:
            so_far = operation(so_far, term[panel], out=part)
    return out


def copied(K: Array, out: Array | None = None) -> Array:
    """The lower half of K, in whatever order that is, in `out` or memory of its own."""
    out = np.empty(K.shape, order="F") if out is None else out
    for panel in panels(len(K)):
        out[panel] = K[panel]
    return out


def diagonal_of(A: Array) -> Array:
    """The diagonal (n,) of A, whose columns follow one another without a gap, to write to."""
    return A.reshape(-1, order="F")[:: len(A) + 1]


def squared(A: Array) -> Array:
    """A Aᵀ of A (n, F)."""
    out = np.empty((len(A), len(A)), order="F")
    for rows, columns in panels(len(A)):
        np.matmul(A[columns], A[rows].T, out=out[rows, columns].T)
    return out


def exponentials(left: Array, right: Array, most: float) -> Array:
    """exp(left rightᵀ), of (n, F) matrices for which that is symmetric.

    The diagonal's exponent is `most`, and no other is above it.
    """
    out = np.empty((len(left), len(left)), order="F")
    diagonal = diagonal_of(out)
    for rows, columns in panels(len(left)):
        exponents = np.matmul(right[columns], left[rows].T, out=out[rows, columns].T)
        diagonal[columns] = most
        if exponents.max() > most:  # by rounding, where two inputs are as good as the same
            np.minimum(exponents, most, out=exponents)
        np.exp(exponents, out=exponents)
    return out


def transposed_times(G: Array, A: Array) -> Array:
    """Gᵀ A (n, F), for G that is zero above the diagonal."""
    out = np.empty(A.shape)
    for rows, columns in panels(len(G)):
        np.matmul(G[rows, columns].T, A[rows], out=out[columns])
    return out


def weighted_sums(G: Array, K: Array, B: Array) -> tuple[Array, Array]:
    """Tᵀ B (n, F) and the sums (n,) of the rows of T = G * K, for G that is zero above the diagonal."""
    n = len(K)
    sums, rows_of_T = np.empty(B.shape), np.zeros(n)
    memory = ones = np.empty(0)
    for rows, columns in panels(n):
        across = G[rows, columns].T
        if not len(memory):  # the first is the largest
            memory, ones = np.empty(across.size), np.ones(len(across))
        T = memory[: across.size].reshape(across.shape)  # transposed: a row is a column of T
        np.multiply(across, K[rows, columns].T, out=T)
        np.matmul(T, B[rows], out=sums[columns])
        rows_of_T[rows] += ones[: len(T)] @ T
    return sums, rows_of_T
