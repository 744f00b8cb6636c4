"""Preprocessing of an arm's logs into samples: inputs, filter, trimming, stiction mask and thinning.

This step decides the error.

A joint that sticks at a reversal is masked long enough. A good feedforward or controller leads a joint
through its reversal in some hundredths of a second. The filter then spreads the friction step over samples of
higher speed, for which the exact model is wrong.

A speed relative to the log's own top speed would count every sample of a joint that is only held as moving.
The model would then learn static friction as dynamics.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from etude.errors import DataError
from etude.logs.cleaning.filters import (
    auto_cutoff,
    duration,
    longest_stretch,
    median_rate,
    resample,
    segments,
    slower,
    smooth,
    thinned,
    uniform_grid,
)
from etude.logs.cleaning.smoothing import quick_length
from etude.types import TARGET, Array, Index, Log, Mask, Samples, joined_samples
from etude_arm.config import ArmData
from etude_arm.memory import remembered, turning
from etude_arm.spec import COMMAND, COMMAND_RATES, FORCES, MEMORY, PATH, PLAN, TURNING, ArmSpec

ROUNDING = 1e-6  # s: time stamps are sums of steps
LEFT = 2.0
"""Times the largest error of the motion."""
LEAST_ROWS = 8
"""A stretch of fewer rows cannot be filtered."""
TARGET_HZ = 10.0
"""Cutoff of the commands against which predictions are scored: one for all cutoffs of learning."""


def near_reversals(speed: Array, slow: Mask, reach: int, longest: int) -> Mask:
    """Mask (T, J) of rows less than `reach` rows from a fast reversal.

    Args:
        speed: (T, J) of each joint, on a uniform grid.
        slow: (T, J) mask of rest.
        reach: rows on either side. The step response of a zero-phase filter of second order falls to a
            hundredth after one period of the cutoff.
        longest: largest number of slow rows in a fast reversal.
    """
    near = np.zeros(speed.shape, dtype=bool)
    for j in range(speed.shape[1]):
        moving = np.flatnonzero(~slow[:, j])
        direction = np.sign(speed[moving, j])
        fast = np.flatnonzero((direction[1:] != direction[:-1]) & (np.diff(moving) <= longest))
        for before, after in zip(moving[fast], moving[fast + 1], strict=True):
            near[max(0, before - reach) : after + reach + 1, j] = True
    return near


def spared(samples: Samples, plenty: int) -> Samples:
    """The samples, with every sample usable again for joints that have fewer than `plenty` left.

    With few samples, the information of a smeared one about inertia outweighs its error about friction. On
    real logs of half a minute, leaving them out raised the error by up to a half.
    """
    few = np.sum(samples.usable & samples.moving, axis=0) < plenty
    return replace(samples, usable=samples.usable | few)


def samples_of(spec: ArmSpec, config: ArmData, logs: Sequence[Log], groups: Sequence[Index]) -> Samples:
    """The samples for a model: filtered, trimmed, thinned, with the stick mask of every command.

    Args:
        spec: gives the velocity limits, the scale of the stick mask.
        config: of the preprocessing.
        logs: cleaned logs with the axes of `spec`, in its order; pauses split them.
        groups: (T,) segment of each row, for each log; it also shifts the thinning, so that repeated motions
            add samples. Rows of a group below 0 are in no segment: the filter uses them, samples do not.

    Raises:
        DataError: the axes differ, a log lacks the desired inputs, or nothing is left.
    """
    if not logs:
        raise DataError("there is no log for training", next_step="Tell one first.")
    parts = [_of_log(spec, config, log, group) for log, group in zip(logs, groups, strict=True)]
    return spared(joined_samples(parts), config.plenty)


def _of_log(spec: ArmSpec, config: ArmData, log: Log, group: Index) -> Samples:
    _check(log, spec, config)
    rate, cutoff = median_rate(log.t), filter_cutoff(log, config)
    group = _without_return(log, group) if config.desired else group
    if config.presliding:
        log = _with_memory(spec, config, log)
    config = replace(config, rate_hz=max(config.rate_hz, config.least_samples / duration(log)))
    stretches = [
        _stretch(log.take(piece), group[piece], rate, cutoff, spec, config) for piece in segments(log.t)
    ]
    parts = [part for part in itertools.chain.from_iterable(stretches) if len(part)]
    if not parts:
        raise DataError(
            f"no rows remain of this log of {log.t[-1] - log.t[0]:.3g} s after trimming",
            where=log.source,
            next_step="Record a longer motion, or lower trim_s.",
        )
    return joined_samples(parts)


def _without_return(log: Log, group: Index) -> Index:
    """Groups (T,), -1 from the row at which the robot leaves the end of its plan.

    A plan rests after its end, so the return would be learned as rest. The robot leaves when it is `LEFT`
    times as far from the plan as ever before.
    """
    if PLAN[1] not in log or PATH[0] not in log:
        return group
    moving = np.flatnonzero(np.any(log[PLAN[1]] != 0.0, axis=1))
    last = int(moving[-1]) if len(moving) else len(log) - 1
    off = np.abs(log[PATH[0]] - log[PLAN[0]])
    departures = np.flatnonzero(np.any(off[last + 1 :] > LEFT * off[: last + 1].max(axis=0), axis=1))
    return group if not len(departures) else np.where(np.arange(len(log)) <= last + departures[0], group, -1)


PLAY = 4.0
"""Half width of the play in deviations of the position's noise. With noise at rest for a minute at 100 Hz the
memory keeps 95 % of itself; with three deviations 88 %, with two 20 %."""
FOURTH_DIFFERENCE = 0.6745 * math.sqrt(70.0)
"""Median of |fourth difference| of independent normal numbers, in their deviations. Of lower order, it is
the acceleration of a fast robot that is seen, and not the noise."""


def resolution(q: Array, quantum: tuple[float, ...] = ()) -> Array:
    """Half width r (J,), rad or m, of the noise and steps of a recorded position q (T, J).

    The encoder's step is `quantum` if known, else the least difference between two recorded positions.
    Smaller noise is ignored.
    """
    # a fourth difference takes five rows
    if len(q) < 5:
        return np.zeros(q.shape[1])
    noise = np.median(np.abs(np.diff(q, 4, axis=0)), axis=0) / FOURTH_DIFFERENCE
    step = np.array(quantum) if quantum else _step(q)
    return np.asarray(np.maximum(PLAY * noise, step))


def _step(q: Array) -> Array:
    """Least difference (J,) between neighbouring rows above rounding; 0 for a constant joint."""
    size = np.abs(np.diff(q, axis=0))
    # of a position, or of 1 rad (m): decimals of a text file come back with less
    rounding = 1e-9 * np.maximum(np.abs(q).max(axis=0), 1.0)
    return np.where((size > rounding).any(axis=0), np.where(size > rounding, size, np.inf).min(axis=0), 0.0)


def standing(speed: Array, spec: ArmSpec, fraction: float, play: Array, cutoff_hz: float) -> Mask:
    """Mask (T, J) of rest: below a fraction of the joint's top speed, or below the encoder's resolution.

    Motion of amplitude `play` (J,) at the filter's cutoff is indistinguishable from rest. So its speed is the
    least speed of motion, for a slow log too; it never exceeds that fraction of the velocity limit.
    """
    relative = slower(speed, spec.velocity, fraction)
    if not math.isfinite(cutoff_hz):
        return relative
    least = np.minimum(2.0 * math.pi * cutoff_hz * play, fraction * spec.velocity)
    return np.asarray(relative | (np.abs(speed) < least))


def _with_memory(spec: ArmSpec, config: ArmData, log: Log) -> Log:
    """The log with friction states from its first row on, and with the resolution of its positions."""
    name = (PLAN if config.desired and PLAN[0] in log else PATH)[0]
    length, channel = spec.presliding(config.presliding), log.channels[name]
    resolved = resolution(log[name], channel.quantum)
    play = np.minimum(resolved, 0.5 * length)
    log = log.put(spec.memory(), remembered(log[name], play, length)[:, 0])
    log = log.put(spec.turning(), turning(log[name], resolved, spec.presliding_distances()))
    return replace(log, channels={**log.channels, name: replace(channel, quantum=tuple(play.tolist()))})


def _check(log: Log, spec: ArmSpec, config: ArmData) -> None:
    parts = log.channels[PATH[0]].parts
    if parts != spec.names:
        raise DataError(
            f"the log has the joints {', '.join(parts)}, but the robot has {', '.join(spec.names)}",
            where=log.source,
            next_step="Tell a log of this robot.",
        )
    if config.desired and PLAN[0] not in log:
        raise DataError(
            "the log has no desired motion, which inputs = 'desired' needs",
            where=log.source,
            next_step="Ingest it with its proposal, or use inputs = 'measured'.",
        )


def filter_cutoff(log: Log, config: ArmData) -> float:
    """Cutoff of the log's filter, Hz; infinite without a filter."""
    if config.cutoff_hz == "none":
        return math.inf
    if config.cutoff_hz != "auto":
        return float(config.cutoff_hz)
    longest = longest_stretch(log)
    grid = uniform_grid(longest.t, median_rate(log.t))
    q = resample(longest.t, longest[PATH[0]], grid)
    command = longest.channels.get(COMMAND)
    force = command is not None and set(command.units) <= set(FORCES)
    cutoff = auto_cutoff(grid, q, STEPS_HZ if force else 0.0)
    if COMMAND not in longest:
        return cutoff
    return _wide_enough(grid, q, resample(longest.t, longest[COMMAND], grid), cutoff)


STEPS_HZ = 5.0
"""Hz that friction's steps need in commands that are forces, however slow the motion. A lower cutoff spreads
them over speeds at which friction is another: with 2 Hz a Kinova j2s6 missed half of its friction near rest.
Of currents the one slow recording (examples/tiago) gains within blocks and loses between quarters.
"""
WIDER = (5.0, TARGET_HZ)
"""Hz: cutoffs tried where that of the positions is lower, since commands have steps that these lack."""
CLEARLY = 0.9
"""Error of a wider cutoff over that of the positions' own, at most; more may be chance."""
ROWS_HZ, BLOCKS, RIDGE = 20.0, 10, 1e-3
"""Rows a second for the score of a cutoff; number of blocks, every other one predicted from the others;
ridge penalty of a row."""
STEP, PER_COLUMN, ROWS_EACH = 0.05, 2, 8
"""Part of the top speed within which friction turns round there. Rows for each regressor, and for each period
of a cutoff, at least."""


def _wide_enough(grid: Array, q: Array, command: Array, cutoff: float) -> float:
    """The positions' cutoff, or the first wider one at which linear regression predicts the target clearly
    better.

    Lower ones are not tried: regression would then err less where its model is wrong, and processes would err
    more.
    """
    quick = quick_length(len(grid), least=2)  # errors that give its score hardly change with a few rows
    grid, q, command = grid[:quick], q[:quick], command[:quick]
    wider = [hz for hz in WIDER if cutoff < hz <= median_rate(grid) / ROWS_EACH]
    rows = np.flatnonzero((grid - grid[0] > 1.0 / cutoff) & (grid[-1] - grid > 1.0 / cutoff))
    rows = rows[:: max(1, int(median_rate(grid) / ROWS_HZ))]
    if not wider or len(rows) < PER_COLUMN * 5 * q.shape[1]:
        return cutoff
    target = smooth(grid, command, TARGET_HZ).value[rows]
    usual, *errors = (_errors(grid, q, command, hz, rows, target) for hz in (cutoff, *wider))
    ratios = [float(np.exp(0.5 * np.mean(np.log(error / usual)))) for error in errors]
    return next((hz for hz, ratio in zip(wider, ratios, strict=True) if ratio <= CLEARLY), cutoff)


def _errors(grid: Array, q: Array, command: Array, cutoff: float, rows: Index, target: Array) -> Array:
    """Mean squared errors (2, J) of both halves, each predicted by ridge regression on the other."""
    motion, taught = smooth(grid, q, cutoff), smooth(grid, command, cutoff).value[rows]
    position, speed, acceleration = (x[rows] for x in (motion.value, motion.first, motion.second))
    steps = np.tanh(speed / np.maximum(STEP * np.abs(speed).max(axis=0), np.finfo(float).tiny))
    L = np.concatenate([speed, acceleration, np.sin(position), np.cos(position), steps], axis=1)
    L = np.column_stack([(L - L.mean(axis=0)) / np.maximum(L.std(axis=0), 1e-9), np.ones(len(L))])
    odd = np.arange(len(rows)) * BLOCKS // len(rows) % 2 == 1
    errors = []
    for training, test in ((odd, ~odd), (~odd, odd)):
        A, b = L[training].T @ L[training], L[training].T @ taught[training]
        weights = np.linalg.solve(A + RIDGE * training.sum() * np.eye(len(A)), b)
        errors.append(np.mean((target[test] - L[test] @ weights) ** 2, axis=0))
    return np.maximum(errors, np.finfo(float).tiny)


def _stretch(
    log: Log, group: Index, rate: float, cutoff: float, spec: ArmSpec, config: ArmData
) -> list[Samples]:
    """Samples of one part between pauses, separate for each segment in it."""
    trim = 1.0 / cutoff if config.trim_s == "auto" else config.trim_s
    if len(log) < LEAST_ROWS or log.t[-1] - log.t[0] <= 2 * trim:
        return []
    grid = uniform_grid(log.t, rate)
    motion = _motion(log, grid, cutoff, config)
    recorded = resample(log.t, log[COMMAND], grid)
    filtered = smooth(grid, recorded, cutoff)
    command = filtered.value
    inside = (grid >= max(0.0, grid[0] + trim) - ROUNDING) & (grid <= grid[-1] - trim + ROUNDING)
    rows = np.searchsorted(log.t, grid + ROUNDING, side="right") - 1
    groups = group[rows]
    names = PLAN if config.desired else PATH
    whole = Log(
        grid,
        {c.name: log.channels.get(c.name, c) for c in spec.channels() if c.name in (*names, COMMAND)},
        {**dict(zip(names, motion, strict=True)), COMMAND: command},
        log.source,
    )
    for channel in (MEMORY, TURNING):
        if channel in log:
            whole = whole.put(log.channels[channel], log[channel][rows])
    target = smooth(grid, recorded, TARGET_HZ).value if math.isfinite(cutoff) else command
    whole = whole.put(replace(whole.channels[COMMAND], name=TARGET, role="aside"), target)
    for name, values in zip(COMMAND_RATES, (filtered.first, filtered.second), strict=True):
        whole = whole.put(replace(whole.channels[COMMAND], name=name, role="aside"), values)
    near = _near_reversals(whole, rate, cutoff, spec, config)
    numbers = np.unique(groups[inside & (groups >= 0)]).tolist()
    pieces = [(n, inside & (groups == n)) for n in numbers]
    return [_segment(whole.take(rows), near[rows], n, rate, cutoff, spec, config) for n, rows in pieces]


def _near_reversals(log: Log, rate: float, cutoff: float, spec: ArmSpec, config: ArmData) -> Mask:
    """Mask (T, J) of smeared fast reversals; empty without a filter or without a mask of rest."""
    speed = log[(PLAN if config.desired else PATH)[1]]
    if not (config.reversal and config.stick_fraction and math.isfinite(cutoff)):
        return np.zeros(speed.shape, dtype=bool)
    slow = slower(speed, spec.velocity, config.stick_fraction)
    return near_reversals(speed, slow, round(config.reversal * rate / cutoff), round(rate / cutoff))


def _segment(
    log: Log, near: Mask, group: int, rate: float, cutoff: float, spec: ArmSpec, config: ArmData
) -> Samples:
    """Thinned rows, with the masks of joints at rest and of reversals."""
    names = PLAN if config.desired else PATH
    play = np.array(log.channels[names[0]].quantum) if MEMORY in log else np.zeros(spec.dof)
    moving = ~standing(log[names[1]], spec, config.stick_fraction, play, cutoff)
    target = np.where(moving.any(axis=1, keepdims=True), log[TARGET], np.nan)
    log = log.put(log.channels[TARGET], target)
    whole = Samples(log, np.full(len(log), group, dtype=np.int64), ~(near & moving), moving)
    return whole.take(thinned(rate, config.rate_hz, group if config.offset == "spread" else 0))


def _motion(log: Log, grid: Array, cutoff: float, config: ArmData) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration on the grid, as inputs of models."""
    if config.desired and all(name in log for name in PLAN):
        q, qd, qdd = (resample(log.t, log[name], grid) for name in PLAN)
        return q, qd, qdd
    position = log[PLAN[0] if config.desired else PATH[0]]
    smoothed = smooth(grid, resample(log.t, position, grid), cutoff)
    return smoothed.value, smoothed.first, smoothed.second
