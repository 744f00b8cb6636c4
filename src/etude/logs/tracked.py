"""How far a run left its plan: the largest errors, by form of motion."""

from __future__ import annotations

import numpy as np

from etude.contracts import Array, Log, Trajectory
from etude.logs.smoothing import median_rate, resample, segments, smooth, uniform_grid

CUTOFF_HZ = 5.0
"""Of the error, before it is differentiated: what a robot does faster is vibration, or noise."""
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
    smoothed = smooth(grid, resample(t, error, grid), min(CUTOFF_HZ, rate / 4.0))
    return np.stack([error, *(resample(grid, part, t) for part in (smoothed.first, smoothed.second))])
