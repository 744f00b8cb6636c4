"""BLAS and LAPACK routines, Fourier transforms and L-BFGS-B of SciPy, under the names that models use."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dgemm, dsyr, dsyrk, dtrmm, dtrsm, dtrsv
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs, dpstrf, dtrtri, dtrtrs

__all__ = [
    "dgemm",
    "dpotrf",
    "dpotri",
    "dpotrs",
    "dpstrf",
    "dsyr",
    "dsyrk",
    "dtrmm",
    "dtrsm",
    "dtrsv",
    "dtrtri",
    "dtrtrs",
    "irfft",
    "minimise",
    "rfft",
]

Array = NDArray[np.float64]
Spectrum = NDArray[np.complex128]
Function = Callable[[Array], tuple[float, Array]]


def rfft(values: Array) -> Spectrum:
    """(F, k) of columns (n, k): NumPy's bits, in half the time."""
    from scipy import fft  # half a tenth of a second, for who filters logs

    return np.asarray(fft.rfft(values, axis=0))


def irfft(spectrum: Spectrum, n: int) -> Array:
    """(n, k) of spectra (F, k)."""
    from scipy import fft

    return np.asarray(fft.irfft(spectrum, n, axis=0))


def minimise(
    function: Function,
    start: Array,
    *,
    steps: int,
    corrections: int = 10,
    searched: int = 20,
    evaluations: int = 15000,
    bounds: Sequence[tuple[float, float]] | None = None,
) -> None:
    """Minimises with L-BFGS-B; `function` records its own best point.

    Args:
        function: (P,) -> its value and gradient (P,).
        start: (P,) where it begins.
        steps: iterations, at most.
        corrections: number of past steps in the curvature estimate.
        searched: largest number of evaluations in one line search.
        evaluations: in all, after which no iteration begins.
        bounds: of each parameter, both of them finite; None: there are none.
    """
    from scipy.optimize import minimize  # a seventh of a second, for who designs or trains

    options = {"maxiter": steps, "maxcor": corrections, "maxls": searched, "maxfun": evaluations}
    minimize(function, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
