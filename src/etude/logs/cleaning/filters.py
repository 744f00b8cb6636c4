"""Filters over whole logs: grid, resample, smooth, differentiate, average, lag, trim, thin, mask.

Filters of arrays are in `smoothing`; those here act on all channels of a log.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from etude._runtime.rounding import MEASURED, whole_down
from etude.errors import DataError
from etude.logs.cleaning.smoothing import (
    Smoothed,
    auto_cutoff,
    median_rate,
    motion_bands,
    resample,
    segments,
    smooth,
    uniform_grid,
)
from etude.types import Array, Channel, Log, Mask

__all__ = [
    "LONGEST_LAG",
    "Smoothed",
    "auto_cutoff",
    "command_lag",
    "differentiated",
    "duration",
    "longest_stretch",
    "looked_at",
    "median_rate",
    "motion_bands",
    "on_grid",
    "resample",
    "sampled",
    "saturated",
    "segments",
    "slower",
    "smooth",
    "thinned",
    "trimmed",
    "uniform",
    "uniform_grid",
    "without_lag",
]
GOLDEN = (math.sqrt(5) - 1) / 2


def duration(log: Log) -> float:
    """Total duration of the log's stretches, s."""
    return float(sum(np.ptp(log.t[piece]) for piece in segments(log.t)))


def longest_stretch(log: Log) -> Log:
    """The longest run of rows without a pause; a repair is noted if rows are dropped."""
    longest = max(segments(log.t), key=lambda piece: piece.stop - piece.start)
    rows = longest.stop - longest.start
    if rows == len(log):
        return log
    sentence = f"The recording pauses; the longest part, {rows} rows, is kept."
    return log.take(longest).repaired(sentence)


MANY_ROWS = 200_000
"""Of a log beyond which its motion is looked at in stretches."""
STRETCHES, STRETCH_ROWS, STRETCH_S = 10, 10_000, 10.0
"""Their number, and how long each is at least: at 1 kHz a tenth of a log of 1000 s."""


def looked_at(log: Log) -> Log:
    """The log; of a very long one only stretches, which are as informative on its motion."""
    if len(log) <= MANY_ROWS:
        return log
    rows = max(STRETCH_ROWS, round(STRETCH_S * median_rate(log.t)))
    if STRETCHES * rows >= len(log):
        return log
    first = np.arange(STRETCHES) * (len(log) - rows) // (STRETCHES - 1)
    return log.take((first[:, None] + np.arange(rows)).ravel())


def uniform(log: Log, rate: float | None = None) -> Log:
    """The longest stretch on a uniform grid at `rate` Hz, by default that of most of its intervals."""
    rate = median_rate(log.t) if rate is None else rate
    log = longest_stretch(log)
    return on_grid(log, uniform_grid(log.t, rate))


def on_grid(log: Log, grid: Array) -> Log:
    """The log at the times `grid` (n,) s, by linear interpolation. Angles that wrap and quaternions that
    change sign are made continuous first.
    """
    values = {
        name: resample(log.t, _continuous(log.channels[name], part), grid)
        for name, part in log.values.items()
    }
    return Log(grid, log.channels, values, log.source, log.repairs)


def _continuous(channel: Channel, values: Array) -> Array:
    if channel.parts == ("w", "x", "y", "z") and len(values):
        flips = np.cumsum((values[1:] * values[:-1]).sum(axis=1) < 0.0) % 2
        return np.asarray(values * np.concatenate([[1.0], 1.0 - 2.0 * flips])[:, None])
    if set(channel.units) == {"rad"} and np.abs(np.diff(values, axis=0)).max(initial=0.0) > np.pi:
        return np.asarray(np.unwrap(values, axis=0))
    return values


def sampled(log: Log, rate: float, *, averaged: bool = True) -> Log:
    """The log at `rate` Hz or slightly above; unchanged if its rate is not higher.

    Args:
        log: on a uniform grid.
        rate: Hz.
        averaged: means over the interval, at its middle, so that noise does not fold in; else single
            samples at its start (thesis).
    """
    ticks = whole_down(median_rate(log.t) / rate, MEASURED)
    count = len(log) // max(ticks, 1)
    if ticks < 2 or count == 0:
        return log
    if not averaged:
        return log.take(slice(0, count * ticks, ticks))

    def mean(values: Array) -> Array:
        shape = (count, ticks, *values.shape[1:])
        return np.asarray(values[: count * ticks].reshape(shape).mean(axis=1))

    values = {name: mean(part) for name, part in log.values.items()}
    return Log(mean(log.t), log.channels, values, log.source, log.repairs)


def differentiated(log: Log, source: str, channel: Channel, cutoff_hz: float) -> Log:
    """The log with `channel`, the zero-phase derivative of its channel `source`, on a uniform grid."""
    return log.put(channel, smooth(log.t, log[source], cutoff_hz).first)


def trimmed(log: Log, first_s: float, last_s: float) -> Log:
    """The log without its first and last seconds.

    Raises:
        DataError: nothing is left.
    """
    since = log.t - log.t[0] if len(log) else log.t
    inside = (since >= first_s) & (since <= (since[-1] if len(log) else 0.0) - last_s)
    if not inside.any():
        raise DataError(
            "no rows of the log remain after trimming",
            where=log.source,
            next_step="Trim less, or record longer.",
        )
    return log.take(inside)


def thinned(rate: float, rate_hz: float, number: int = 0) -> slice:
    """Which rows of a log at `rate` Hz to keep, so that at least `rate_hz` remain per second.

    `number` of the trajectory shifts the first: multiples of the golden ratio visit the step evenly,
    whatever the number of logs, so that repeated motions add samples.
    """
    # 1e-3: rates are medians of time stamps, and 99.99 Hz thinned to 50 Hz is every second row
    step = max(1, whole_down(rate / rate_hz, 1e-3))
    return slice(int(step * ((number * GOLDEN) % 1.0)), None, step)


def slower(speed: Array, top: Array, fraction: float) -> Mask:
    """(T, k) where |speed| (T, k) is less than that part of its largest value, or of `top` (k,) if less."""
    reached = np.minimum(top, np.abs(speed).max(axis=0, initial=0.0))
    return np.asarray(np.abs(speed) < fraction * reached)


def saturated(command: Array, lower: Array, upper: Array, part: float = 1e-3) -> Mask:
    """(T, J) True where the distance of a command to its limit is less than that part of its range."""
    near = part * (upper - lower)
    return np.asarray((command <= lower + near) | (command >= upper - near))


LONGEST_LAG = 0.2  # s: largest lag of motors of a flying vehicle


def command_lag(logs: Sequence[Log], states: Sequence[str], longest: float = LONGEST_LAG) -> float:
    """The lag in [0, longest] s at which the motion explains the commands best, s.

    Commands `lag` earlier are fitted by least squares from the present states and a constant for each log.
    The lag with the least residual wins, refined by a parabola. The fit uses levels, as a model does. Rates
    of change would emphasise noise and the fastest motion, which a motor with a time constant lags less: on
    real flights that lag gave models a larger error.

    Args:
        logs: of one robot with one lag. Logs that are too slow or too short do not count.
        states: channels of the motion; a channel that one log lacks is omitted for all.
        longest: s.

    Returns:
        0 if no log is informative.
    """
    # twenty times the longest lag: else a correlation is of too few rows
    able = [log for log in logs if 1 <= int(longest * median_rate(log.t)) < len(log) / 20.0 - 1.0]
    names = [name for name in states if all(name in log for log in able)]
    if not able or not names:
        return 0.0
    rate = min(median_rate(log.t) for log in able)
    lags = np.arange(int(longest * rate) + 1) / rate
    Q = np.linalg.qr(np.concatenate([_centred(_motion(log, names)[_late(log, longest)]) for log in able]))[0]
    left = np.array([_residual(Q, np.concatenate([_earlier(log, k, longest) for log in able])) for k in lags])
    best = int(np.argmin(left))
    return float((best + _vertex(left, best)) / rate)


def without_lag(log: Log, lag: float) -> Log:
    """The log with the commands of `lag` s earlier; its first rows are cut.

    Raises:
        DataError: the log is shorter than the lag.
    """
    if lag == 0.0:
        return log
    inside = log.t - lag >= log.t[0]
    if not inside.any():
        raise DataError(
            f"the log is shorter than a lag of {lag:g} s",
            where=log.source,
            next_step="Record a longer motion, or correct the lag.",
        )
    command = resample(log.t, log["command"], log.t[inside] - lag)
    return log.take(inside).put(log.channels["command"], command)


def _motion(log: Log, names: Sequence[str]) -> Array:
    """(T, m) the quantities of the channels in `names`."""
    return np.column_stack([log[name] for name in names])


def _late(log: Log, longest: float) -> Mask:
    """(T,) samples whose commands of `longest` ago are recorded: the same for every lag."""
    return np.asarray(log.t >= log.t[0] + longest)


def _earlier(log: Log, lag: float, longest: float) -> Array:
    """(n, J) commands of `lag` before the late samples, centred."""
    return _centred(resample(log.t, log["command"], log.t[_late(log, longest)] - lag))


def _centred(values: Array) -> Array:
    return np.asarray(values - values.mean(axis=0))


def _residual(Q: Array, Y: Array) -> float:
    """Part of Y's squares outside the range of Q, mean over the commands."""
    inside = ((Q.T @ Y) ** 2).sum(axis=0)
    whole = np.maximum((Y * Y).sum(axis=0), np.finfo(float).tiny)
    return float(np.mean(1.0 - inside / whole))


def _vertex(values: Array, best: int) -> float:
    """Place of the parabola's bottom through three values, relative to the middle one."""
    if not 0 < best < len(values) - 1:
        return 0.0
    a, b, c = values[best - 1 : best + 2]
    bend = a - 2.0 * b + c
    return 0.0 if bend <= 0.0 else float(0.5 * (a - c) / bend)
