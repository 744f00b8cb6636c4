"""Delay between two recorded signals, by cross-correlation of their rates of change."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Delay:
    """How far `response` lags behind `reference`.

    Attributes:
        seconds: the lag; positive when the response comes later.
        correlation: correlation coefficient of the two at that lag, over their overlap, in [-1, 1].
    """

    seconds: float
    correlation: float


def measure_delay(
    reference: Array, response: Array, rate: float, lags: tuple[float, float] = (-1.0, 1.0)
) -> Delay:
    """The lag in `lags` (s) at which the columns of two signals (T, k) and (S, k) at `rate` Hz fit best.

    Both are differenced, so that offsets do not count, and scaled per column, so that units do not. The lag
    is refined below one sample by a parabola through the three best values. Signals may differ in
    length: row 0 of both is the same instant at lag 0.
    """
    a, b = _rates(reference), _rates(response)
    n = 1 << (len(a) + len(b)).bit_length()
    spectrum = np.conj(np.fft.rfft(a, n, axis=0)) * np.fft.rfft(b, n, axis=0)
    product = np.fft.irfft(spectrum.sum(axis=1), n)
    low = max(int(np.floor(lags[0] * rate)), 1 - len(a))
    high = min(int(np.ceil(lags[1] * rate)), len(b) - 1)
    shifts = np.arange(low, high + 1)
    values = product[shifts % n]
    best = int(np.argmax(values))
    seconds = (shifts[best] + _parabola_top(values, best)) / rate
    return Delay(float(seconds), _overlap_correlation(a, b, int(shifts[best])))


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


def _overlap_correlation(a: Array, b: Array, shift: int) -> float:
    start, stop = max(0, -shift), min(len(a), len(b) - shift)
    x, y = a[start:stop], b[start + shift : stop + shift]
    norm = np.sqrt((x * x).sum() * (y * y).sum())
    return float((x * y).sum() / norm) if norm > 0 else 0.0
