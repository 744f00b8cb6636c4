"""Extremes of a trigonometric polynomial over all angles: a proved bound from samples, and exact roots."""

from __future__ import annotations

import math

import numpy as np

from etude.errors import UsageError
from etude.types import Array

OVERSAMPLING = 64
"""Samples per degree of a proof: the bound exceeds the true extreme by at most 0.12 %."""
USABLE_PART = 1.0 - 1e-9
"""Usable fraction of each limit, so that rounding never puts a proposed trajectory just outside."""
ROUNDING = 64.0 * float(np.finfo(float).eps)
"""Allowance for rounding in evaluating a series, relative to the sum of its amplitudes."""


def grid(degree: int, oversampling: int) -> tuple[Array, float]:
    """M = oversampling * degree angles on the circle, and kappa = cos(pi degree / M).

    Raises:
        UsageError: fewer than 3 samples per degree; the bound would not exist (M > 2N is needed).
    """
    if degree < 1 or oversampling < 3:
        raise UsageError(
            f"a certificate needs degree >= 1 and oversampling >= 3, not {degree}, {oversampling}"
        )
    size = oversampling * degree
    return 2.0 * np.pi * np.arange(size) / size, math.cos(math.pi * degree / size)


def riesz_range(values: Array, kappa: float, amplitude: Array | float = 0.0) -> tuple[Array, Array]:
    """Interval that holds a trigonometric polynomial at every angle, from its samples on `grid`.

    M. Riesz: near a point of largest modulus, p decreases no faster than a cosine of the same degree. So
    max |p| <= max_j |p_j| / cos(pi N/M); applied to p - c with c the middle of the samples.

    Args:
        values: (M, k) samples of k polynomials of degree <= N.
        kappa: cos(pi N/M).
        amplitude: (k,) sum of the absolute terms of each polynomial, for the rounding allowance.

    Returns:
        lower (k,), upper (k,).
    """
    low, high = values.min(axis=0), values.max(axis=0)
    if kappa == 1.0:  # samples include the extremes; subtracting a centre would only add rounding errors
        return low - ROUNDING * amplitude, high + ROUNDING * amplitude
    centre, reach = 0.5 * (high + low), 0.5 * (high - low) / kappa + ROUNDING * amplitude
    return centre - reach, centre + reach
