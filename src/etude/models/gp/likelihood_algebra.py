"""Factor, inverse and solutions of a covariance matrix in one pass, for its marginal likelihood.

With K = L Lᵀ and X = L^-1, by blocks of rows: the factor's own block and what it takes from the rest, as in a
Cholesky factorisation; the rows of X by substitution in L X = I; and their share of K^-1 = Xᵀ X. All go on in
the same memory: what is still to be factorised gives way to L, then to -L X, to X and to K^-1. LAPACK does it
in three, `dpotrf`, `dtrtri` and `dlauum`, with as many operations, n³ in all. But the inverse of a triangle
alone has small triangles in its way; together nearly everything is an update of the whole matrix by a few
rows, the fastest thing a BLAS has.

Outputs Y (n, m) stand below K as m more rows, with zeros in the corner, and are never factorised themselves:
as rows of L they become (L^-1 Y)ᵀ, as rows of -L X then -(K^-1 Y)ᵀ, and the corner -Yᵀ K^-1 Y. As X solves
L X = I, Xᵀ z is as good as the solution of Lᵀ α = z (Higham, Accuracy and Stability of Numerical Algorithms,
14.2).

SciPy's wrappers take whole arrays: of a block inside one they make a copy, which costs what working by blocks
gains. So the routines are called where SciPy offers them to compiled code (`scipy.linalg.cython_blas`), by
address. All arguments are addresses, as Fortran wants them: the letters below, `number`, `whole`, and of a
block `place` of its first entry. Nothing is checked here: whoever calls answers for shapes and for the order.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from ctypes import (
    CFUNCTYPE,
    PYFUNCTYPE,
    byref,
    c_char,
    c_char_p,
    c_double,
    c_int,
    c_void_p,
    py_object,
    pythonapi,
)
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from scipy import LowLevelCallable
from scipy.linalg import cython_blas, cython_lapack

from etude._runtime.scipy_parts import dpotrf, dpotri, dpotrs, dsyrk
from etude.models.gp.cholesky import copied, diagonal_of, with_jitter
from etude.models.gp.kernel_algebra import VJP
from etude.types import Array

BLOCK = 96
"""Rows at a time: with fewer the products are slow, with more what is done inside a block counts."""
LEAST_SIZE = 2 * BLOCK
"""Up to here calls cost more than the one pass gains."""
ALIGNED = 8
"""Columns begin at multiples of so many numbers, a line of cache."""


Routine = Callable[..., None]

INTEGER = re.compile(r"(?<!\w)int \*")
LEFT = LOWER = byref(c_char(b"L"))
RIGHT = byref(c_char(b"R"))
UPPER = byref(c_char(b"U"))
PLAIN = byref(c_char(b"N"))
"""Not transposed; or a diagonal that is read."""
TRANSPOSED = byref(c_char(b"T"))


@dataclass(frozen=True)
class Routines:
    """The routines in double precision, named as in BLAS and LAPACK."""

    gemm: Routine
    syrk: Routine
    trmm: Routine
    trsm: Routine
    potrf: Routine
    trtri: Routine
    lauum: Routine
    laset: Routine


@cache
def routines() -> Routines | None:
    """They, or None if this SciPy's have other integers than C's `int`, as with a BLAS of 64 bits."""
    pointers = [
        _routine(cython_blas, "dgemm", integers=6),
        _routine(cython_blas, "dsyrk", integers=4),
        _routine(cython_blas, "dtrmm", integers=4),
        _routine(cython_blas, "dtrsm", integers=4),
        _routine(cython_lapack, "dpotrf", integers=3),
        _routine(cython_lapack, "dtrtri", integers=3),
        _routine(cython_lapack, "dlauum", integers=3),
        _routine(cython_lapack, "dlaset", integers=3),
    ]
    return None if None in pointers else Routines(*pointers)


@cache
def number(value: float) -> Any:
    """The address of a number that nobody writes to."""
    return byref(c_double(value))


@cache
def whole(value: int) -> Any:
    """The address of an integer that nobody writes to."""
    return byref(c_int(value))


def place(address: int) -> Any:
    """The address of a block's first entry, as an argument."""
    return c_void_p(address)


def _routine(module: Any, name: str, *, integers: int) -> Any:
    low_level = LowLevelCallable.from_cython(module, name)
    if len(INTEGER.findall(low_level.signature)) != integers:
        return None
    address = PYFUNCTYPE(c_void_p, py_object, c_char_p)(("PyCapsule_GetPointer", pythonapi))
    # without argument types: their conversion would take as long as the rest of the call
    return CFUNCTYPE(None)(address(low_level.function, low_level.signature.encode()))


NONE, ONE, MINUS = number(0.0), number(1.0), number(-1.0)


@dataclass(frozen=True, eq=False)
class Solved:
    """What K_y = K + noise says of outputs Y (n,) or (n, m).

    Attributes:
        square: sum(Y * K_y^-1 Y). log_det: of K_y.
        weights: (n, n) the lower half of m K_y^-1 - Σ_j α_j α_jᵀ with α = K_y^-1 Y, zero above: minus twice
            the slope of log p(Y) in K_y. In memory of its own, column by column.
    """

    square: float
    log_det: float
    weights: Array

    def slopes(self, vjp: VJP) -> tuple[Array, float]:
        """Minus the slopes of log p(Y) in theta (P,) and in the noise variance; uses the weights up."""
        diagonal = np.einsum("ii->i", self.weights)
        in_noise = 0.5 * float(diagonal.sum())
        diagonal *= 0.5  # half the weights, their upper half folded onto the lower one
        return vjp(self.weights), in_noise


def solved(K: Array, noise_variance: float, Y: Array) -> Solved:
    """Of K (n, n), of which the lower half alone is read, and Y (n,) or (n, m).

    Raises:
        NumericalError: as `factorise`, whose jitter it adds where needed without a word.
    """
    columns, blas = Y.reshape(len(Y), -1), routines()

    def attempt(diagonal: Array) -> Solved | None:
        if blas is None or len(K) <= LEAST_SIZE:
            return factor_by_lapack(K, diagonal, columns)
        return factor_in_one_pass(K, diagonal, columns, blas)

    return with_jitter(K, noise_variance, attempt)[0]


def factor_by_lapack(K: Array, diagonal: Array, Y: Array) -> Solved | None:
    """By LAPACK's three, of K with that diagonal (n,) and Y (n, m); None if it is indefinite."""
    A = copied(K)
    diagonal_of(A)[:] = diagonal
    L, failed = dpotrf(A, lower=1, overwrite_a=1, clean=1)
    pivots = L.diagonal().copy()
    if failed or not np.isfinite(pivots).all():
        return None
    alpha, _ = dpotrs(L, Y, lower=1)
    inverse, _ = dpotri(L, lower=1, overwrite_c=1)
    weights = dsyrk(-1.0, alpha, beta=float(Y.shape[1]), lower=1, c=inverse, overwrite_c=1)
    return Solved(float(np.sum(Y * alpha)), _log_det(pivots), weights)


def factor_in_one_pass(K: Array, diagonal: Array, Y: Array, use: Routines) -> Solved | None:
    """The same in one pass."""
    sweep = _Pass(K, diagonal, Y, use)
    for first in range(0, sweep.n, BLOCK):
        if not sweep.through(first, min(first + BLOCK, sweep.n)):
            return None
    if not np.isfinite(sweep.pivots).all():
        return None
    return Solved(-float(np.trace(sweep.corner)), _log_det(sweep.pivots), sweep.weights())


def _log_det(pivots: Array) -> float:
    return 2.0 * float(np.log(pivots).sum())


class _Pass:
    """One pass over K (n, n) with Y (n, m) below it."""

    def __init__(self, K: Array, diagonal: Array, Y: Array, use: Routines) -> None:
        n, m = Y.shape
        rows = ALIGNED * -(-(n + m) // ALIGNED)
        memory = np.empty((rows, n + m), order="F")
        self.n, self.m, self.use, self.pivots = n, m, use, np.empty(n)
        self.A, self.corner = memory[:n, :n], memory[n : n + m, n:]
        copied(K, self.A)
        self.diagonal = memory.reshape(-1, order="F")[: n * rows : rows + 1]
        self.diagonal[:], memory[n : n + m, :n], self.corner[:] = diagonal, Y.T, 0.0
        self.memory, self.start, self.stride, self.rows = memory, memory.ctypes.data, rows, whole(rows)

    def at(self, row: int, column: int) -> Any:
        """The address of an entry."""
        # 8 bytes a float64
        return place(self.start + 8 * (row + column * self.stride))

    def through(self, first: int, last: int) -> bool:
        """Takes the rows from first to last; False if K is indefinite."""
        use, rows, size, before = self.use, self.rows, whole(last - first), whole(first)
        left = whole(self.n + self.m - last)
        corner, row, below = self.at(first, first), self.at(first, 0), self.at(last, first)
        failed = c_int(0)
        use.potrf(LOWER, size, corner, rows, byref(failed))
        if failed.value:
            return False
        self.pivots[first:last] = self.diagonal[first:last]
        # L below the corner, X left of it, and what both take from what is below
        use.trsm(RIGHT, LOWER, TRANSPOSED, PLAIN, left, size, ONE, corner, rows, below, rows)
        use.syrk(LOWER, PLAIN, left, size, MINUS, below, rows, ONE, self.at(last, last), rows)
        if first:
            use.trsm(LEFT, LOWER, PLAIN, PLAIN, size, before, ONE, corner, rows, row, rows)
            use.gemm(
                PLAIN, PLAIN, left, before, size, MINUS, below, rows, row, rows, ONE, self.at(last, 0), rows
            )
            use.syrk(LOWER, TRANSPOSED, before, size, ONE, row, rows, ONE, self.at(0, 0), rows)
        # X in the corner: -L X below it, and its share of K^-1
        use.trtri(LOWER, PLAIN, size, corner, rows, byref(failed))
        use.trmm(RIGHT, LOWER, PLAIN, PLAIN, left, size, MINUS, corner, rows, below, rows)
        if first:
            use.trmm(LEFT, LOWER, TRANSPOSED, PLAIN, size, before, ONE, corner, rows, row, rows)
        use.lauum(LOWER, size, corner, rows, byref(failed))
        return True

    def weights(self) -> Array:
        """m K^-1 - Σ α αᵀ, from K^-1 and the rows of -α below it; zero above the diagonal."""
        n, outputs, scale = whole(self.n), whole(self.m), number(float(self.m))
        alpha, first = self.at(self.n, 0), self.at(0, 0)
        self.use.syrk(LOWER, TRANSPOSED, n, outputs, MINUS, alpha, self.rows, scale, first, self.rows)
        order = whole(self.n - 1)
        self.use.laset(UPPER, order, order, NONE, NONE, self.at(0, 1), self.rows)
        return self.A
