"""Tracking errors of a run: the largest ones, by form of motion, once tracking has settled.

A run may begin with a transient: a plan that starts with a step, or integrators that have to find the weight.
It shows the error of a start, not that of tracking. It ends as a step response settles: where the envelope of
the error first stays inside its final band.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.logs.cleaning.smoothing import (
    NYQUIST_SHARE,
    median_rate,
    noise_deviation,
    resample,
    segments,
    smooth,
    uniform_grid,
)
from etude.protocols import Trajectory
from etude.types import Array, Log, Mask

LEAST_HZ = 5.0
"""Hz: lowest cutoff of the error before differentiation; higher if noise allows."""
NOISY = 0.1
"""Largest noise, of `PEAKS` deviations, as a part of the largest rate."""
PEAKS = 4.0  # deviations: one sample in 16,000 of normal noise is beyond
PASSED = 0.2777
"""Integral of x^2/(1 + x^4)^2 over x > 0: white noise that is differentiated behind the filter. That of
x^4/(1 + x^4)^2, for the second derivative, is the same.
"""
HIDDEN = 0.5
"""Noise, of `PEAKS` deviations, as a part of the largest acceleration, beyond which it is not known."""
ORDERS = 3
"""Position, velocity, acceleration."""
LEAST_ROWS = 8
"""Least number of rows for differentiation."""
HELD = 2
"""Orders that decide a start: position and velocity, which have margins."""
BAND = 0.5
"""The last part of a run, of its duration: the largest errors there are the band."""
STAYS = 0.125
"""Part of the duration for which a settled error stays inside the band."""
LATEST = 0.45
"""Part of the duration within which the error must settle: otherwise the whole log counts."""
EDGE, BEYOND = 2.0, 4.0
"""Times the band: inside of which an error has settled, as motions leave more here and less there; and which
a start must reach. One that does not may be chance, and counts: margins have factors of 1.5 to 3 for it.
"""
SIMILAR_RATES = 1.0 / EDGE
"""Part of what the start asks of each coordinate, in speed and acceleration, that the rest must ask too: a
joint that moves at first and then stands has no transient, but a motion.
"""


@dataclass(frozen=True, eq=False)
class Start:
    """A start transient: until when, s of the trajectory, and the largest errors (ORDERS, k) before."""

    until: float
    errors: Array


@dataclass(frozen=True, eq=False)
class Tracked:
    """By form of motion (ORDERS, k) the largest |measured - planned| of position, velocity, acceleration, and
    the start transient that is not in them; None where there is none. An acceleration that the noise of
    positions hides is NaN.
    """

    errors: dict[str, Array]
    start: Start | None = None


def largest_errors(log: Log, trajectory: Trajectory, path: str) -> dict[str, Array]:
    """By form of motion, (ORDERS, k) the largest errors; see `tracked`."""
    return tracked(log, trajectory, path).errors


def tracked(log: Log, trajectory: Trajectory, path: str) -> Tracked:
    """Tracking errors of the run, with the start transient separate.

    A chain counts as the forms of its pieces. Rates are those of the position's error, smoothed without
    phase: a logged velocity has a filter of its own. Rows before and after the trajectory do not count. No
    errors where the log lacks the path or is too short.
    """
    if path not in log:
        return Tracked({})
    error = log[path] - trajectory.motion(np.clip(log.t, 0.0, trajectory.duration), 1).orders[0]
    stretches = [piece for piece in segments(log.t) if piece.stop - piece.start >= LEAST_ROWS]
    if not stretches:
        return Tracked({})
    t = np.concatenate([log.t[rows] for rows in stretches])
    sizes = np.concatenate([np.abs(_orders(log.t[rows], error[rows])) for rows in stretches], axis=1)
    inside = (t >= 0.0) & (t <= trajectory.duration)
    until = _settled(t[inside], sizes[:HELD, inside], trajectory) if inside.any() else 0.0
    largest: dict[str, Array] = {}
    for start, _, piece in trajectory.pieces():
        within = (t >= max(start, until)) & (t <= start + piece.duration)
        if within.any():
            most = sizes[:, within].max(axis=1)
            largest[piece.form] = np.maximum(largest.get(piece.form, most), most)
    if until == 0.0:
        return Tracked(largest)
    return Tracked(largest, Start(until, sizes[:, (t >= 0.0) & (t < until)].max(axis=1)))


def _settled(t: Array, sizes: Array, trajectory: Trajectory) -> float:
    """s, when the errors (HELD, T, k) at times t (T,) have settled first; 0 without a transient."""
    duration = trajectory.duration
    late = t >= (1.0 - BAND) * duration
    if not late.any() or late.all():
        return 0.0
    band = np.maximum(sizes[:, late].max(axis=1, keepdims=True), np.finfo(float).tiny)
    beyond = (sizes / band).max(axis=(0, 2))
    outside = t[beyond > EDGE]  # the last one in each window decides whether it stays
    ends = np.concatenate([[0.0], outside])
    following = np.concatenate([outside, [np.inf]])
    until = float(ends[np.argmax(following - ends > STAYS * duration)])
    before = t <= until
    if not 0.0 < until <= LATEST * duration or beyond[before].max() < BEYOND:
        return 0.0
    later = float(t[~before][0]) if (~before).any() else 0.0
    return later if _stays_as_fast(t, before, trajectory) else 0.0


def _stays_as_fast(t: Array, before: Mask, trajectory: Trajectory) -> bool:
    """Whether the later motion is about as fast as the start, in each coordinate."""
    planned_rates = np.abs(trajectory.motion(t, ORDERS).orders[1:])
    first, later = planned_rates[:, before].max(axis=1), planned_rates[:, ~before].max(axis=1)
    return bool(np.all(later >= SIMILAR_RATES * first))


def _orders(t: Array, error: Array) -> Array:
    """(ORDERS, T, k) the error and its smoothed derivatives at times t (T,)."""
    rate = median_rate(t)
    grid = uniform_grid(t, rate)
    values = resample(t, error, grid)
    # half of the Nyquist frequency at most: a filter needs room above its cutoff
    gentle = min(LEAST_HZ, 0.25 * rate)
    noise, coarse = noise_deviation(grid, values), smooth(grid, values, gentle)
    sizes = [np.abs(part).max(axis=0) for part in (coarse.first, coarse.second)]
    cutoffs = [np.maximum(_allowed(size, noise, rate, k), gentle) for k, size in enumerate(sizes, 1)]
    first, second = (
        np.column_stack(
            [getattr(smooth(grid, values[:, [j]], hz), name) for j, hz in enumerate(own.tolist())]
        )
        for own, name in zip((cutoffs[0], np.minimum(*cutoffs)), ("first", "second"), strict=True)
    )
    second[:, PEAKS * _left(noise, gentle, rate, 2) > HIDDEN * sizes[1]] = np.nan
    inside = (grid >= grid[0] + 1.0 / gentle) & (grid <= grid[-1] - 1.0 / gentle)  # the filter's edges ring
    return np.stack([error, *(resample(grid, inside[:, None] * part, t) for part in (first, second))])


def _left(noise: Array, cutoff: float, rate: float, order: int) -> Array:
    """(k,) deviations of the derivative of white noise (k,) behind the filter."""
    deviation = (2.0 * np.pi) ** order * noise * np.sqrt(2.0 * PASSED * cutoff ** (2 * order + 1) / rate)
    return np.asarray(deviation)


def _allowed(largest: Array, noise: Array, rate: float, order: int) -> Array:
    """(k,) Hz up to which noise stays below its part of the largest derivatives (k,), at most rate/8."""
    most = 0.5 * NYQUIST_SHARE * rate
    at_one_hz = PEAKS * _left(np.maximum(noise, np.finfo(float).tiny), 1.0, rate, order)
    return np.minimum((NOISY * largest / at_one_hz) ** (2.0 / (2 * order + 1)), most)
