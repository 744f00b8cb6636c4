"""Smoothing and differentiation of logs: zero phase, exact derivatives of the smoothed signal.

The filter is the squared gain of a second-order Butterworth low-pass (a forward and a backward pass),
applied in the frequency domain, where differentiation is a multiplication by i omega: position, velocity and
acceleration are consistent with each other and with the command, which passes through the same filter.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from etude._runtime.rounding import MEASURED, whole_down
from etude._runtime.scipy_parts import irfft, rfft
from etude.types import Array

BAND_ENERGY = 0.9  # share of the velocity's energy that defines the motion's band
BAND_FACTOR = 20.0  # cutoff over that band: forces have harmonics, and steps where friction changes sign
PASS_FACTOR = 4.0  # least cutoff over that band: its edge keeps 0.996 of its size
NYQUIST_SHARE = 0.25  # the cutoff never exceeds this part of half the rate: rate / 8
NOISE_FACTOR = 20.0  # spectral lines below this many noise levels count as noise
CUTOFF_CHOICES = 64  # tried, evenly spaced in logarithm: 8 % apart over two decades
QUICK_FACTORS = (2, 3, 5, 7, 11)  # factors for which the FFT has special loops
LONG = 10_000  # rows
GAP_FACTOR = 10.0  # a pause of this many median intervals splits a log


@dataclass(frozen=True, eq=False)
class Smoothed:
    """A filtered signal on a uniform grid of T rows. Each derivative is computed on demand.

    Attributes:
        t: (T,) s, uniform.
        line: (T, k) through the end points, of which `slope` (k,) is the rate.
        spectrum: (F, k) of the rest, continued oddly and filtered.
    """

    t: Array
    line: Array
    slope: Array
    spectrum: NDArray[np.complex128]

    @cached_property
    def value(self) -> Array:
        """(T, k) the filtered signal."""
        return self.line + self._derivative(0)

    @cached_property
    def first(self) -> Array:
        """(T, k) its first time derivative."""
        return self.slope + self._derivative(1)

    @cached_property
    def second(self) -> Array:
        """(T, k) its second time derivative."""
        return self._derivative(2)

    def _derivative(self, order: int) -> Array:
        n = len(self.t)
        step = float(self.t[-1] - self.t[0]) / (n - 1)
        omega = 2 * np.pi * np.fft.rfftfreq(2 * (n - 1), step)[:, None]
        return irfft(self.spectrum * (1j * omega) ** order, 2 * (n - 1))[:n]


def median_rate(t: Array) -> float:
    """The sampling rate in Hz that most intervals of t (T,) have."""
    return float(1.0 / np.median(np.diff(t)))


def segments(t: Array) -> list[slice]:
    """The stretches of t (T,) between pauses longer than GAP_FACTOR median intervals."""
    if len(t) < 2:
        return [slice(0, len(t))]
    steps = np.diff(t)
    cuts = np.flatnonzero(steps > GAP_FACTOR * np.median(steps)) + 1
    edges = [0, *cuts.tolist(), len(t)]
    return [slice(a, b) for a, b in itertools.pairwise(edges)]


def uniform_grid(t: Array, rate: float) -> Array:
    """Times from t[0] to t[-1] at `rate` Hz. A grid that is already uniform is reproduced to rounding."""
    count = whole_down((t[-1] - t[0]) * rate, MEASURED) + 1
    return np.asarray(t[0] + np.arange(count) / rate)


def resample(t: Array, values: Array, grid: Array) -> Array:
    """Linear interpolation of values (T, k) at `grid` (n,), (n, k)."""
    return np.column_stack([np.interp(grid, t, column) for column in values.T])


def smooth(t: Array, values: Array, cutoff_hz: float, order: int = 2) -> Smoothed:
    """Zero-phase low-pass and derivatives of values (T, k) given on a uniform grid t (T,).

    The line through the end points is set aside and the rest continued oddly, so that the signal is
    periodic with continuous slope and the ends do not ring. The squared gain is 1 / (1 + (f / fc)^(2 order)),
    or 2^-(f / fc)^2 for `order` 0: a Gaussian, which rings at no step. `cutoff_hz` = inf differentiates
    without filtering.
    """
    step = float(t[-1] - t[0]) / (len(t) - 1)
    slope = (values[-1] - values[0]) / (t[-1] - t[0])
    line = values[0] + (t - t[0])[:, None] * slope
    residual = values - line
    odd = np.concatenate([residual[:-1], -residual[:0:-1]])
    part = (np.fft.rfftfreq(len(odd), step)[:, None] / cutoff_hz) ** (2 * order or 2)
    return Smoothed(t, line, slope, rfft(odd) * (1.0 / (1.0 + part) if order else np.exp2(-part)))


def quick_length(n: int, least: int = LONG) -> int:
    """Rows, n or a few fewer, that `smooth` filters fast: its period 2 (n - 1) has small factors only.

    A period with a large prime factor takes up to ten times as long. Fewer rows than `least` are all kept.
    """
    if n < least:
        return n
    return next(m for m in range(n, 1, -1) if _small_factors(m - 1))


def _small_factors(number: int) -> bool:
    for factor in QUICK_FACTORS:
        while number % factor == 0:
            number //= factor
    return number == 1


def auto_cutoff(t: Array, q: Array, least_hz: float = 0.0) -> float:
    """A cutoff in Hz for positions q (T, dof) on a uniform grid: what the motion needs and noise allows.

    The motion needs BAND_FACTOR times the widest joint's `motion_bands`, and `least_hz`; the noise allows
    `_noise_cutoff`. The smaller counts, but never less than PASS_FACTOR times the band, so that noise cannot
    take the motion itself, nor more than an eighth of the sampling rate. All joints share one filter, so that
    their dynamics stay coupled in phase.
    """
    rate = (len(t) - 1) / float(t[-1] - t[0])
    highest = NYQUIST_SHARE * rate / 2
    spectrum = _spectrum(t, q)
    bands = _bands(spectrum)
    if not np.any(bands > 0):
        return highest
    lowest, needed = (min(factor * float(bands.max()), highest) for factor in (PASS_FACTOR, BAND_FACTOR))
    return _noise_cutoff(spectrum, lowest, max(needed, min(least_hz, highest)))


@dataclass(frozen=True)
class _Spectrum:
    """frequency (F,) Hz; signal (F, dof) power of the lines above the noise; noise (dof,) power per line."""

    frequency: Array
    signal: Array
    noise: Array


def _spectrum(t: Array, q: Array) -> _Spectrum:
    """Separates lines from white noise, whose level is the median of the spectrum's upper half."""
    n = len(t)
    line = q[0] + np.linspace(0.0, 1.0, n)[:, None] * (q[-1] - q[0])
    power = np.abs(np.fft.rfft((q - line) * np.hanning(n)[:, None], axis=0)) ** 2
    # The power of one line of white noise is exponentially distributed: its mean is the median over log 2.
    noise = np.median(power[len(power) // 2 :], axis=0) / np.log(2.0)
    signal = np.where(power > NOISE_FACTOR * noise, power, 0.0)
    frequency: Array = np.fft.rfftfreq(n, float(t[-1] - t[0]) / (n - 1)).astype(np.float64)
    return _Spectrum(frequency, signal, np.asarray(noise, dtype=np.float64))


def noise_deviation(t: Array, q: Array) -> Array:
    """(dof,) standard deviation of the white noise on q (T, dof), on a uniform grid, from its upper band."""
    window = np.hanning(len(t))
    return np.sqrt(_spectrum(t, q).noise / float(window @ window))


def motion_bands(t: Array, q: Array) -> Array:
    """(dof,) Hz: the frequency below which BAND_ENERGY of each joint's velocity energy lies; 0 at rest."""
    return _bands(_spectrum(t, q))


def _bands(spectrum: _Spectrum) -> Array:
    energy = np.cumsum(spectrum.signal * spectrum.frequency[:, None] ** 2, axis=0)
    bands = np.zeros(energy.shape[1])
    for j in np.flatnonzero(energy[-1] > 0):
        bands[j] = spectrum.frequency[np.searchsorted(energy[:, j], BAND_ENERGY * energy[-1, j])]
    return bands


def _noise_cutoff(spectrum: _Spectrum, lowest: float, highest: float) -> float:
    """The cutoff with the least expected error of the acceleration, over `lowest` to `highest` Hz.

    The error of a joint is what the filter takes from its lines plus the noise that it lets through, both
    times omega^4, over the energy of its acceleration; joints are averaged geometrically.
    """
    weight = spectrum.frequency**4
    moving = weight @ spectrum.signal > 0
    signal, noise = spectrum.signal[:, moving], spectrum.noise[moving]
    cutoffs = np.geomspace(lowest, highest, CUTOFF_CHOICES)
    risks = np.empty(CUTOFF_CHOICES)
    for i, cutoff in enumerate(cutoffs):
        gain = 1.0 / (1.0 + (spectrum.frequency / cutoff) ** 4)
        error = (weight * (1 - gain) ** 2) @ signal + (weight @ gain**2) * noise
        risks[i] = np.mean(np.log(error / (weight @ signal) + np.finfo(float).tiny))
    return float(cutoffs[np.argmin(risks)])
