"""Cholesky factors of covariance matrices, jitter for indefinite ones, and lower halves by panels.

A panel is so many columns from their diagonal down. It stays in the processor's second cache from one step to
the next; above the diagonal no more than the panel's own small triangle is computed or read.
Matrices here are (n, n) in Fortran order; above the diagonal they may hold anything.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

import numpy as np

from etude._runtime.scipy_parts import dpotrf, dpotri, dpotrs, dtrtri
from etude.errors import NumericalError
from etude.types import Array

Result = TypeVar("Result")

FIRST_JITTER, LAST_JITTER = 1e-10, 1e-4  # parts of the largest entry: rounding, up to what changes a result


class JitterWarning(UserWarning):
    """A covariance matrix needed something added to its diagonal before it could be factorised."""


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
    from etude.models.gp.exponential import exponentials_in_place  # loads a compiler

    out = np.empty((len(left), len(left)), order="F")
    diagonal = diagonal_of(out)
    for rows, columns in panels(len(left)):
        np.matmul(right[columns], left[rows].T, out=out[rows, columns].T)
        diagonal[columns] = most
        # at most `most`: rounding may exceed it where two inputs are as good as the same
        exponentials_in_place(out.T, most, columns, rows)
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


def factorise(K: Array, noise_variance: float, *, announce: bool = True) -> tuple[Array, float]:
    """Lower Cholesky factor L (n, n), zero above, of K + noise_variance I, and the jitter that was added.

    K is symmetric and left as it was; its lower half alone is read. When rounding makes it indefinite the
    diagonal grows by 1e-10 of its mean, then ten times more, up to 1e-4, with a JitterWarning that gives the
    amount.

    Raises:
        NumericalError: K is not finite, or zero, or 1e-4 of its diagonal was not enough.
    """

    def attempt(diagonal: Array) -> Array | None:
        A = copied(K)
        diagonal_of(A)[:] = diagonal
        L, failed = dpotrf(A, lower=1, overwrite_a=1, clean=1)
        return None if failed or not np.isfinite(L[-1, -1]) else L

    L, jitter = with_jitter(K, noise_variance, attempt)
    if jitter and announce:
        scale = float(K.diagonal().mean()) + noise_variance
        warnings.warn(
            f"added {jitter:.1e} to the diagonal of a covariance matrix of scale {scale:.1e}",
            JitterWarning,
            stacklevel=2,
        )
    return L, jitter


def with_jitter(
    K: Array, noise_variance: float, attempt: Callable[[Array], Result | None]
) -> tuple[Result, float]:
    """What `attempt` makes of the diagonal (n,) of K + noise_variance I, raised until it is not None.

    Returns:
        that and the jitter, which `factorise` describes; and its errors.
    """
    diagonal = K.diagonal() + noise_variance
    scale = float(diagonal.mean())
    if not np.isfinite(scale):
        raise NumericalError("the covariance matrix is not finite", next_step="Check the hyperparameters.")
    if not FIRST_JITTER * scale > 0.0:  # a jitter that is rounded to zero would be raised for ever
        raise NumericalError("the covariance matrix is zero", next_step="Check the hyperparameters.")
    jitter = 0.0
    # 1.001: the last power of ten is tried too, however it is rounded
    while jitter <= 1.001 * LAST_JITTER * scale:
        result = attempt(diagonal + jitter)
        if result is not None:
            return result, jitter
        jitter = max(10.0 * jitter, FIRST_JITTER * scale)
    raise NumericalError(
        f"a covariance matrix of {len(K)} points is indefinite even with {LAST_JITTER:.0e} of its "
        "scale on the diagonal",
        next_step="Raise the noise floor or drop repeated points.",
    )


def inverse_lower(L: Array) -> Array:
    """Lower triangle of (L Lᵀ)^-1, zero above, in the memory of L."""
    W, failed = dpotri(L, lower=1, overwrite_c=1)
    if failed:
        raise NumericalError("a Cholesky factor has a zero on its diagonal")
    return np.asarray(W)


def triangular_inverse(L: Array) -> Array:
    """L^-1, lower, zero above. As accurate as triangular solves, and products with it are faster."""
    inverse, failed = dtrtri(L, lower=1)
    if failed:
        raise NumericalError("a Cholesky factor has a zero on its diagonal")
    return np.asarray(inverse)


def solved_in_place(M: Array, B: Array) -> Array:
    """M^-1 B, of M (n, n) symmetric, positive definite and in Fortran order, whose memory its factor takes.

    Raises:
        NumericalError: M is not finite, or not positive definite.
    """
    if not np.isfinite(M).all():
        raise NumericalError("a matrix to be solved with is not finite")
    L, failed = dpotrf(M, lower=1, overwrite_a=1, clean=0)
    if failed:
        raise NumericalError(f"a matrix of {len(M)} samples to be solved with is not positive definite")
    return np.asarray(dpotrs(L, B, lower=1)[0])
