"""Tests and intervals for one number a seed: x (n,), paired by seed before it comes here.

All of them need two finite numbers or more. A spread below rounding counts as none: a t test then says 0 or
1, and the sign flips, which need no spread, decide.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri, stdtr, stdtrit

from etude.errors import UsageError
from etude.types import Array

FLIPS = 20_000
RESAMPLES = 9_999
GENERATOR = 20_140_827
"""Seed of the flips and of the bootstrap, the same for every part: a verdict is a function of the data."""
ROUNDING = 1e-12
"""Of the largest |x|: a smaller standard deviation is rounding."""


def moments(x: ArrayLike) -> tuple[int, float, float]:
    """Count, mean, and standard deviation (n - 1) of x (n,), which is 0 where it is only rounding.

    Raises:
        UsageError: fewer than two numbers, or one that is not finite.
    """
    sample = _checked(x)
    sd = float(sample.std(ddof=1))
    return len(sample), float(sample.mean()), 0.0 if sd <= ROUNDING * float(np.abs(sample).max()) else sd


def paired_t(x: ArrayLike) -> float:
    """Two-sided p of "the mean is 0". Without spread: 1 for a mean of 0, else 0."""
    n, mean, sd = moments(x)
    return 2.0 * _tail(n, -abs(mean), sd) if mean != 0.0 else 1.0


def interval(x: ArrayLike, level: float = 0.95) -> tuple[float, float]:
    """The t interval of the mean."""
    n, mean, sd = moments(x)
    half = _quantile(n, level) * sd / math.sqrt(n)
    return mean - half, mean + half


def prediction_interval(x: ArrayLike, level: float = 0.95) -> tuple[float, float]:
    """Where one more run lies: mean +- t sd sqrt(1 + 1/n)."""
    n, mean, sd = moments(x)
    half = _quantile(n, level) * sd * math.sqrt(1.0 + 1.0 / n)
    return mean - half, mean + half


def sign_flip(x: ArrayLike, *, two_sided: bool = True) -> float:
    """p of "x is as likely as -x", seed by seed, from FLIPS random signs; one-sided against a mean above 0.

    The observed signs count as one of the draws, so that p is never 0 (Phipson & Smyth 2010).
    """
    sample = _checked(x)
    sums, observed = _signs(len(sample), FLIPS) @ sample, float(sample.sum())
    if two_sided:
        sums, observed = np.abs(sums), abs(observed)
    # flips that only reorder the sum are as far out as the observed one
    equal = ROUNDING * float(np.abs(sample).sum())
    return (1.0 + float(np.count_nonzero(sums >= observed - equal))) / (FLIPS + 1.0)


def equivalence(x: ArrayLike, margin: float) -> float:
    """p of two one-sided t tests of |mean| < margin (Schuirmann 1987); below 0.05: 90 % interval inside."""
    n, mean, sd = moments(x)
    return _tail(n, abs(mean) - margin, sd)


def equivalence_flip(x: ArrayLike, margin: float) -> float:
    """The same by sign flips of x + margin and margin - x."""
    sample = _checked(x)
    return max(sign_flip(sample + margin, two_sided=False), sign_flip(margin - sample, two_sided=False))


def outside(x: ArrayLike, margin: float) -> float:
    """Two-sided p of a mean beyond +-margin, 1 for one within; below 0.05: 95 % interval wholly outside."""
    n, mean, sd = moments(x)
    return min(1.0, 2.0 * _tail(n, margin - abs(mean), sd))


def outside_flip(x: ArrayLike, margin: float) -> float:
    """The same by sign flips of x less the margin that it is beyond."""
    sample = _checked(x)
    mean = float(sample.mean())
    return sign_flip(sample - math.copysign(margin, mean)) if abs(mean) > margin else 1.0


def bca(x: ArrayLike, level: float = 0.95) -> tuple[float, float]:
    """Bias-corrected and accelerated bootstrap interval of the mean over seeds (Efron 1987)."""
    sample = _checked(x)
    n, mean, sd = moments(sample)
    if sd == 0.0:
        return mean, mean
    means = sample[_resamples(n, RESAMPLES)].mean(axis=1)
    below = 0.5 * (np.mean(means < mean) + np.mean(means <= mean))
    bias, turn = float(ndtri(below)), _acceleration(sample)
    z = bias + ndtri(np.array([0.5 - 0.5 * level, 0.5 + 0.5 * level]))
    low, high = np.quantile(means, ndtr(bias + z / (1.0 - turn * z)))
    return float(low), float(high)


def wilson(wins: int, n: int, level: float = 0.95) -> tuple[float, float]:
    """Interval of a share, `wins` of `n` (Wilson 1927).

    Raises:
        UsageError: no trial, or more wins than trials.
    """
    if n < 1 or not 0 <= wins <= n:
        raise UsageError(f"{wins} of {n} is no share", next_step="Count wins among seeds.")
    z, share = float(ndtri(0.5 + 0.5 * level)), wins / n
    centre = (share + z * z / (2 * n)) / (1.0 + z * z / n)
    half = z / (1.0 + z * z / n) * math.sqrt(share * (1.0 - share) / n + z * z / (4 * n * n))
    return max(0.0, centre - half), min(1.0, centre + half)


def holm(p: Sequence[float]) -> Array:
    """Adjusted p (m,): the chance of any false rejection in the family stays below the level (Holm 1979)."""
    p_values, order = _probabilities(p)
    adjusted = np.maximum.accumulate(p_values[order] * np.arange(len(p_values), 0, -1))
    return _back(np.minimum(adjusted, 1.0), order)


def benjamini_hochberg(p: Sequence[float]) -> Array:
    """Adjusted p (m,): the expected share of false ones among the rejected stays below the level (1995)."""
    p_values, order = _probabilities(p)
    scaled = p_values[order] * len(p_values) / np.arange(1, len(p_values) + 1)
    adjusted = np.minimum.accumulate(scaled[::-1])[::-1]
    return _back(np.minimum(adjusted, 1.0), order)


def holm_levels(p: Sequence[float], level: float) -> Array:
    """(m,) that each p has to meet to be found next, the others as they are."""
    rejected = holm(p) < level
    return np.asarray(level / (len(rejected) - (rejected.sum() - rejected)))


def benjamini_hochberg_levels(p: Sequence[float], level: float) -> Array:
    """The same for Benjamini and Hochberg."""
    rejected = benjamini_hochberg(p) < level
    return np.asarray(level * (1 + rejected.sum() - rejected) / max(len(rejected), 1))


@lru_cache(maxsize=8)
def _signs(n: int, flips: int) -> Array:
    """(flips, n) of +-1."""
    heads = np.random.default_rng(GENERATOR).integers(0, 2, (flips, n))
    return np.where(heads == 1, 1.0, -1.0)


@lru_cache(maxsize=8)
def _resamples(n: int, draws: int) -> NDArray[np.int64]:
    """(draws, n) places in a sample."""
    return np.random.default_rng(GENERATOR).integers(0, n, (draws, n))


def _checked(x: ArrayLike) -> Array:
    sample = np.asarray(x, dtype=np.float64)
    if sample.ndim != 1 or len(sample) < 2 or not np.isfinite(sample).all():
        fact = f"a statistic over seeds needs two finite numbers or more, not {sample.tolist()}"
        raise UsageError(fact, next_step="Run more seeds, or leave out those without a number.")
    return sample


def _probabilities(p: Sequence[float]) -> tuple[Array, NDArray[np.intp]]:
    p_values = np.asarray(p, dtype=np.float64)
    if not ((p_values >= 0.0) & (p_values <= 1.0)).all():
        raise UsageError("a p value is outside 0 .. 1", next_step="Give 1 where there is no test.")
    return p_values, np.argsort(p_values, kind="stable")


def _back(ordered: Array, order: NDArray[np.intp]) -> Array:
    out = np.empty_like(ordered)
    out[order] = ordered
    return out


def _tail(n: int, mean: float, sd: float) -> float:
    """P(T <= t) of a t variable with n - 1 degrees of freedom; without spread 0 left of 0, else 1."""
    if sd == 0.0:
        return 0.0 if mean < 0.0 else 1.0
    return float(stdtr(n - 1, mean * math.sqrt(n) / sd))


def _quantile(n: int, level: float) -> float:
    return float(stdtrit(n - 1, 0.5 + 0.5 * level))


def _acceleration(x: Array) -> float:
    """A sixth of the skewness of the mean, by the jackknife."""
    left_out = (x.sum() - x) / (len(x) - 1)
    d = left_out.mean() - left_out
    return float((d**3).sum() / (6.0 * (d**2).sum() ** 1.5))
