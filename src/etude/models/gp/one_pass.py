"""What a likelihood asks of a covariance matrix, in one pass over it: factor, inverse and solutions together.

With K = L Lᵀ and X = L^-1, by blocks of rows: the factor's own block and what it takes from the rest (a Cholesky
factorisation from the left up), the rows of X by substitution in L X = I, and their share of K^-1 = Xᵀ X. The
three go on in the same memory: below the diagonal what is still to be factorised gives way to L, to -L X and to
K^-1. Each does what LAPACK does in `dpotrf`, `dtrtri` and `dlauum` one after the other, with as many operations,
n³ in all. But the inverse of a triangle alone has small triangles in its way, and together nearly everything is
an update of the whole matrix by a few rows, the fastest thing a BLAS has.

As X solves L X = I, Xᵀ z is as good as the solution of Lᵀ α = z (Higham, Accuracy and Stability of Numerical
Algorithms, 14.2).
"""

from __future__ import annotations

from ctypes import byref, c_int
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs

from etude.models.gp.cholesky import with_jitter
from etude.models.gp.fortran import (
    LEFT,
    LOWER,
    PLAIN,
    RIGHT,
    TRANSPOSED,
    UPPER,
    Routines,
    number,
    place,
    routines,
    whole,
)
from etude.models.gp.lower_half import diagonal_of

Array = NDArray[np.float64]

BLOCK = 96
"""Rows at a time: with fewer the products are slow, with more what is done inside a block counts."""
LEAST = 2 * BLOCK
"""Up to here calls cost more than the one pass gains."""

NONE, ONE, MINUS = number(0.0), number(1.0), number(-1.0)


@dataclass(frozen=True, eq=False)
class Solved:
    """What K_y = K + noise says of outputs Y (n,) or (n, m).

    Attributes:
        alpha: K_y^-1 Y, as Y. square: sum(Y * alpha). log_det: of K_y.
        inverse: (n, n) the lower half of K_y^-1, zero above, Fortran order, memory of its own.
    """

    alpha: Array
    square: float
    log_det: float
    inverse: Array


def solved(K: Array, noise_variance: float, Y: Array) -> Solved:
    """Of K (n, n), of which the lower half alone is read, and Y (n,) or (n, m).

    Raises:
        NumericalError: as `factorise`, whose jitter it adds where needed without a word.
    """
    known = routines() if len(K) > LEAST else None
    attempt = (lambda A: by_parts(A, Y)) if known is None else (lambda A: in_one(A, Y, known))
    return with_jitter(K, noise_variance, attempt)[0]


def by_parts(A: Array, Y: Array) -> Solved | None:
    """The same by LAPACK's three, in the memory of A = K_y; None if that is indefinite."""
    L, failed = dpotrf(A, lower=1, overwrite_a=1, clean=1)
    pivots = L.diagonal().copy()
    if failed or not np.isfinite(pivots).all():
        return None
    alpha, _ = dpotrs(L, Y, lower=1)
    inverse, _ = dpotri(L, lower=1, overwrite_c=1)
    return Solved(alpha, float(np.sum(Y * alpha)), _log_det(pivots), inverse)


def in_one(A: Array, Y: Array, use: Routines) -> Solved | None:
    """In one pass, in the memory of A = K_y, Fortran order; None if that is indefinite."""
    way = _Pass(A, np.array(Y.reshape(len(Y), -1), order="F"), use)
    for first in range(0, len(A), BLOCK):
        if not way.through(first, min(first + BLOCK, len(A))):
            return None
    if not np.isfinite(way.pivots).all():
        return None
    way.clear_above()
    return Solved(way.alpha.reshape(Y.shape), float(np.sum(way.Z * way.Z)), _log_det(way.pivots), A)


def _log_det(pivots: Array) -> float:
    return 2.0 * float(np.log(pivots).sum())


class _Pass:
    """One pass over A (n, n); Z (n, m) is Y and becomes L^-1 Y, alpha grows to K^-1 Y."""

    def __init__(self, A: Array, Z: Array, use: Routines) -> None:
        self.A, self.Z, self.use = A, Z, use
        self.alpha, self.pivots = np.zeros_like(Z), np.empty(len(A))
        self.diagonal = diagonal_of(A)
        self.start, self.outputs, self.found = (own.ctypes.data for own in (A, Z, self.alpha))
        self.rows, self.columns = whole(len(A)), whole(Z.shape[1])

    def at(self, row: int, column: int) -> Any:
        """The address of an entry."""
        return place(self.start + 8 * (row + column * len(self.A)))

    def through(self, first: int, last: int) -> bool:
        """Takes the rows from first to last; False if K is indefinite."""
        own, before, rows, use = whole(last - first), whole(first), self.rows, self.use
        corner, row, failed = self.at(first, first), self.at(first, 0), c_int(0)
        use.potrf(LOWER, own, corner, rows, byref(failed))
        if failed.value:
            return False
        self.pivots[first:last] = self.diagonal[first:last]
        # the rows of L^-1 Y and of X, as far as they lie before the corner
        z = place(self.outputs + 8 * first)
        use.trsm(LEFT, LOWER, PLAIN, PLAIN, own, self.columns, ONE, corner, rows, z, rows)
        if first:
            use.trsm(LEFT, LOWER, PLAIN, PLAIN, own, before, ONE, corner, rows, row, rows)
        if last < len(self.A):
            self._factorise_below(first, last)
        use.trtri(LOWER, PLAIN, own, corner, rows, byref(failed))
        if last < len(self.A):
            left, below = whole(len(self.A) - last), self.at(last, first)
            use.trmm(RIGHT, LOWER, PLAIN, PLAIN, left, own, MINUS, corner, rows, below, rows)
        self._add_share(first, last)
        return True

    def _factorise_below(self, first: int, last: int) -> None:
        """The columns of L under the corner, and what they take from A, L^-1 Y and L X below."""
        own, left, rows, use = whole(last - first), whole(len(self.A) - last), self.rows, self.use
        below, rest = self.at(last, first), self.at(last, last)
        use.trsm(RIGHT, LOWER, TRANSPOSED, PLAIN, left, own, ONE, self.at(first, first), rows, below, rows)
        use.syrk(LOWER, PLAIN, left, own, MINUS, below, rows, ONE, rest, rows)
        self.Z[last:] -= self.A[last:, first:last] @ self.Z[first:last]
        if first:
            row, under = self.at(first, 0), self.at(last, 0)
            use.gemm(PLAIN, PLAIN, left, whole(first), own, MINUS, below, rows, row, rows, ONE, under, rows)

    def _add_share(self, first: int, last: int) -> None:
        """What the rows of X give to α = Xᵀ z and to K^-1 = Xᵀ X, their own part in their own place."""
        own, before, rows, use = whole(last - first), whole(first), self.rows, self.use
        corner, row = self.at(first, first), self.at(first, 0)
        z, alpha = self.Z[first:last], place(self.found + 8 * first)
        self.alpha[first:last] = z
        use.trmm(LEFT, LOWER, TRANSPOSED, PLAIN, own, self.columns, ONE, corner, rows, alpha, rows)
        if first:
            self.alpha[:first] += self.A[first:last, :first].T @ z
            use.syrk(LOWER, TRANSPOSED, before, own, ONE, row, rows, ONE, self.at(0, 0), rows)
            use.trmm(LEFT, LOWER, TRANSPOSED, PLAIN, own, before, ONE, corner, rows, row, rows)
        use.lauum(LOWER, own, corner, rows, byref(c_int(0)))

    def clear_above(self) -> None:
        """Zeros above the diagonal."""
        order = whole(len(self.A) - 1)
        self.use.laset(UPPER, order, order, NONE, NONE, self.at(0, 1), self.rows)
