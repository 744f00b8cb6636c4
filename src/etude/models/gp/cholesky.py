"""Cholesky factors of covariance matrices, and what to do when rounding makes one indefinite."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from etude.blas import dpotrf, dpotri, dpotrs, dtrtri
from etude.errors import NumericalError
from etude.models.gp.lower_half import copied, diagonal_of
from etude.types import Array

Found = TypeVar("Found")

FIRST_JITTER, LAST_JITTER = 1e-10, 1e-4


class JitterWarning(UserWarning):
    """A covariance matrix needed something added to its diagonal before it could be factorised."""


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
    K: Array, noise_variance: float, attempt: Callable[[Array], Found | None]
) -> tuple[Found, float]:
    """What `attempt` makes of the diagonal (n,) of K + noise_variance I, raised until it is not None.

    Returns:
        that and the jitter, which `factorise` describes; and its errors.
    """
    diagonal = K.diagonal() + noise_variance
    scale = float(diagonal.mean())
    if not np.isfinite(scale):
        raise NumericalError("the covariance matrix is not finite", next_step="Look at the hyperparameters.")
    if not FIRST_JITTER * scale > 0.0:  # a jitter that is rounded to zero would be raised for ever
        raise NumericalError("the covariance matrix is zero", next_step="Look at the hyperparameters.")
    jitter = 0.0
    while jitter <= 1.001 * LAST_JITTER * scale:
        found = attempt(diagonal + jitter)
        if found is not None:
            return found, jitter
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
