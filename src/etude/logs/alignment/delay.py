"""Delays at which one recorded signal follows another, by cross-correlation of their rates of change."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.types import Array, Index

LEAST_OVERLAP = 0.4  # of the shorter signal: a shorter overlap fits well by chance
MOST = 64  # delays that are worth a closer look
WORTH = 0.5  # of the best correlation


@dataclass(frozen=True)
class Delay:
    """How far `response` lags behind `reference`.

    Attributes:
        seconds: the lag; positive when the response comes later.
        correlation: correlation coefficient of the two at that lag, over their overlap, in [-1, 1].
    """

    seconds: float
    correlation: float


def likely_delays(
    reference: Array, response: Array, rate: float, lags: tuple[float, float] = (-1.0, 1.0)
) -> list[Delay]:
    """The lags in `lags` (s) at which the columns of two signals (T, k) and (S, k) at `rate` Hz fit, best
    first: a motion that repeats itself fits at several.

    Both are differenced, so that offsets do not count, and scaled per column, so that units do not. The
    correlation coefficient over the overlap counts, which is at least LEAST_OVERLAP of the shorter signal; a
    parabola through three neighbours refines each lag below a sample. Signals may differ in length: row 0 of
    both is the same instant at lag 0.
    """
    a, b = _rates(reference), _rates(response)
    overlap = max(2, int(LEAST_OVERLAP * min(len(a), len(b))))
    low = max(int(np.floor(lags[0] * rate)), overlap - len(a))
    high = min(int(np.ceil(lags[1] * rate)), len(b) - overlap)
    shifts = np.arange(low, max(high, low) + 1)
    values = _correlations(a, b, shifts)
    padded = np.concatenate([[-np.inf], values, [-np.inf]])
    tops = np.flatnonzero((values >= padded[:-2]) & (values > padded[2:]))
    tops = tops[np.argsort(-values[tops], kind="stable")][:MOST]
    best = float(values[tops[0]])
    least = best - (1.0 - WORTH) * abs(best)  # negative where nothing fits
    worth = [int(top) for top in tops if values[top] >= least]
    return [
        Delay(float((shifts[top] + _parabola_top(values, top)) / rate), float(values[top])) for top in worth
    ]


def measure_delay(
    reference: Array, response: Array, rate: float, lags: tuple[float, float] = (-1.0, 1.0)
) -> Delay:
    """The best of `likely_delays`."""
    return likely_delays(reference, response, rate, lags)[0]


def _correlations(a: Array, b: Array, shifts: Index) -> Array:
    """Correlation coefficient of a[i] with b[i + shift] over their overlap, for each shift."""
    n = 1 << (len(a) + len(b)).bit_length()
    spectrum = np.conj(np.fft.rfft(a, n, axis=0)) * np.fft.rfft(b, n, axis=0)
    product = np.fft.irfft(spectrum.sum(axis=1), n)[shifts % n]
    start = np.maximum(0, -shifts)
    stop = np.minimum(len(a), len(b) - shifts)
    energy_a, energy_b = (np.concatenate([[0.0], np.cumsum((x * x).sum(axis=1))]) for x in (a, b))
    norm = (energy_a[stop] - energy_a[start]) * (energy_b[stop + shifts] - energy_b[start + shifts])
    values = product / np.sqrt(np.maximum(norm, np.finfo(float).tiny))
    return np.asarray(np.where(np.isfinite(values), values, -1.0))  # of numbers too wild to correlate


def _rates(values: Array) -> Array:
    rates = np.diff(values, axis=0)
    scale = rates.std(axis=0)
    return rates / np.where(scale > 0, scale, 1.0)


def _parabola_top(values: Array, best: int) -> float:
    if not 0 < best < len(values) - 1:
        return 0.0
    left, top, right = values[best - 1 : best + 2]
    bend = left - 2 * top + right
    return 0.0 if bend == 0 else float(0.5 * (left - right) / bend)
