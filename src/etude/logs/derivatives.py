"""Smoothing and differentiation of logs: zero phase, exact derivatives of the smoothed signal.

The filter is the squared gain of a second-order Butterworth low-pass (a forward and a backward pass),
applied in the frequency domain, where differentiation is a multiplication by i omega: position, velocity and
acceleration are consistent with each other and with the command, which passes through the same filter.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BAND_ENERGY = 0.99  # share of the velocity's energy that defines the motion's band
BAND_FACTOR = 8.0  # cutoff over that band: gain 0.9998 at the band's edge
NYQUIST_SHARE = 0.25  # the cutoff never exceeds this part of half the rate: rate / 8
NOISE_FACTOR = 20.0  # spectral lines below this many noise levels are taken for noise
GAP_FACTOR = 10.0  # a pause of this many median intervals splits a log


@dataclass(frozen=True)
class Smoothed:
    """A filtered signal on a uniform grid.

    Attributes:
        t: (T,) s, uniform.
        value, first, second: (T, k) the filtered signal and its first two time derivatives.
    """

    t: Array
    value: Array
    first: Array
    second: Array


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
    count = int(np.floor((t[-1] - t[0]) * rate + 1e-6)) + 1
    return np.asarray(t[0] + np.arange(count) / rate)


def resample(t: Array, values: Array, grid: Array) -> Array:
    """Linear interpolation of values (T, k) at `grid` (n,), (n, k)."""
    return np.column_stack([np.interp(grid, t, column) for column in values.T])


def smooth(t: Array, values: Array, cutoff_hz: float) -> Smoothed:
    """Zero-phase low-pass and derivatives of values (T, k) given on a uniform grid t (T,).

    The line through the end points is set aside and the rest continued oddly, so that the signal is
    periodic with continuous slope and the ends do not ring. The squared gain is 1 / (1 + (f / fc)^4);
    `cutoff_hz` = inf differentiates without filtering.
    """
    n, step = len(t), float(t[-1] - t[0]) / (len(t) - 1)
    slope = (values[-1] - values[0]) / (t[-1] - t[0])
    line = values[0] + (t - t[0])[:, None] * slope
    rest = values - line
    odd = np.concatenate([rest[:-1], -rest[:0:-1]])
    frequency = np.fft.rfftfreq(len(odd), step)[:, None]
    spectrum = np.fft.rfft(odd, axis=0) / (1.0 + (frequency / cutoff_hz) ** 4)
    omega = 2 * np.pi * frequency
    parts = [np.fft.irfft(spectrum * (1j * omega) ** k, len(odd), axis=0)[:n] for k in range(3)]
    return Smoothed(t, line + parts[0], slope + parts[1], parts[2])


def auto_cutoff(t: Array, q: Array) -> float:
    """A cutoff in Hz for positions q (T, dof) on a uniform grid: BAND_FACTOR times the motion's band.

    The band of a joint is the frequency below which BAND_ENERGY of its velocity's energy lies, counting only
    spectral lines well above the white measurement noise (whose level is the median of the upper half
    of the position's spectrum); the widest joint decides, since all joints share one filter. The result stays
    between four periods in the log and an eighth of the sampling rate.
    """
    rate = (len(t) - 1) / float(t[-1] - t[0])
    highest = NYQUIST_SHARE * rate / 2
    lowest = min(4.0 / float(t[-1] - t[0]), highest)
    bands = [band for band in motion_bands(t, q) if band > 0]
    return float(np.clip(BAND_FACTOR * max(bands), lowest, highest)) if bands else highest


def motion_bands(t: Array, q: Array) -> Array:
    """(dof,) Hz: the frequency below which BAND_ENERGY of each joint's velocity energy lies; 0 at rest."""
    n = len(t)
    step = float(t[-1] - t[0]) / (n - 1)
    line = q[0] + np.linspace(0.0, 1.0, n)[:, None] * (q[-1] - q[0])
    power = np.abs(np.fft.rfft((q - line) * np.hanning(n)[:, None], axis=0)) ** 2
    frequency = np.fft.rfftfreq(n, step)
    noise = np.median(power[len(power) // 2 :], axis=0) / np.log(2.0)
    energy = np.where(power > NOISE_FACTOR * noise, power * frequency[:, None] ** 2, 0.0)
    total = energy.sum(axis=0)
    bands = np.zeros(q.shape[1])
    for j in np.flatnonzero(total > 0):
        bands[j] = frequency[np.searchsorted(np.cumsum(energy[:, j]), BAND_ENERGY * total[j])]
    return bands
