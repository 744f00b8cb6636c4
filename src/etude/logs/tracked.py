"""How far a run left its plan: the largest errors, by form of motion."""

from __future__ import annotations

import numpy as np

from etude.contracts import Array, Log, Trajectory
from etude.logs.smoothing import (
    NYQUIST_SHARE,
    median_rate,
    noise_deviation,
    resample,
    segments,
    smooth,
    uniform_grid,
)

LEAST_HZ = 5.0
"""The error is smoothed no more than this before it is differentiated, and less where noise allows."""
NOISY = 0.1
"""Part of the largest rate that noise may reach, in `PEAKS` deviations."""
PEAKS = 4.0
PASSED = 0.2777
"""Integral of x^2/(1 + x^4)^2 over x > 0: white noise that is differentiated behind the filter."""
ORDERS = 3
"""Position, velocity, acceleration."""
LEAST_ROWS = 8
"""Fewer cannot be differentiated."""


def largest_errors(log: Log, trajectory: Trajectory, path: str) -> dict[str, Array]:
    """By form of motion, (ORDERS, k) the largest |measured - asked| of position, velocity, acceleration.

    A chain counts as the forms of its pieces. Rates are those of the position's error, smoothed without
    phase: a logged velocity has a filter of its own. Rows before and after the trajectory do not count. {}
    where the log lacks the path or is too short.
    """
    if path not in log:
        return {}
    error = log[path] - trajectory.motion(np.clip(log.t, 0.0, trajectory.duration), 1).orders[0]
    found: dict[str, Array] = {}
    for stretch in segments(log.t):
        if stretch.stop - stretch.start < LEAST_ROWS:
            continue
        t, sizes = log.t[stretch], np.abs(_orders(log.t[stretch], error[stretch]))
        for start, _, piece in trajectory.pieces():
            own = (t >= start) & (t <= start + piece.duration)
            if own.any():
                most = sizes[:, own].max(axis=1)
                found[piece.form] = np.maximum(found.get(piece.form, most), most)
    return found


def _orders(t: Array, error: Array) -> Array:
    """(ORDERS, T, k) the error as it is and its smoothed rates, at times t (T,)."""
    rate = median_rate(t)
    grid = uniform_grid(t, rate)
    values = resample(t, error, grid)
    gentle = min(LEAST_HZ, 0.25 * rate)
    rates = np.abs(smooth(grid, values, gentle).first).max(axis=0)
    cutoffs = np.clip(_allowed(rates, noise_deviation(grid, values), rate), gentle, None)
    parts = [smooth(grid, values[:, [j]], cutoff) for j, cutoff in enumerate(cutoffs.tolist())]
    first, second = (np.hstack([getattr(part, name) for part in parts]) for name in ("first", "second"))
    inside = (grid >= grid[0] + 1.0 / gentle) & (grid <= grid[-1] - 1.0 / gentle)  # the filter's edges ring
    return np.stack([error, *(resample(grid, inside[:, None] * part, t) for part in (first, second))])


def _allowed(rates: Array, noise: Array, rate: float) -> Array:
    """(k,) Hz up to which noise stays below its part of the largest rates (k,), at most rate/8."""
    most = 0.5 * NYQUIST_SHARE * rate
    deviation = 2.0 * np.pi * np.maximum(noise, np.finfo(float).tiny) * PEAKS
    return np.minimum(np.cbrt((NOISY * rates / deviation) ** 2 * rate / (2.0 * PASSED)), most)
