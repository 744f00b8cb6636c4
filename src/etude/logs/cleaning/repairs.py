"""Row repairs: rows that are dropped, and logs that are refused. Nothing is interpolated here.

Each repair adds one sentence to `Log.repairs`.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence

import numpy as np

from etude.errors import DataError
from etude.logs.cleaning.ranges import RARE, bounded, top_speed, without_rows
from etude.logs.cleaning.smoothing import GAP_FACTOR, segments
from etude.logs.columns.units import Limits
from etude.types import Array, Channel, Finding, Index, Log, Mask

LARGEST_LOSS = 0.2  # largest part of unusable rows; otherwise the log is refused
LARGEST_PAUSE = 0.5  # largest part of the duration in pauses
REWIND_SECONDS = 1.0  # s: a larger step back in time that lasts is a second recording


def drop_unreadable(log: Log, *, recorded: bool = True) -> Log:
    """Drops optional channels that are mostly empty, then rows with an empty, NaN or infinite cell.

    Args:
        recorded: the log is a recording: a constant rate of a moving path was never filled. Otherwise the
            constant is intended.

    Raises:
        DataError: too many rows would go.
    """
    for name, channel in log.channels.items():
        if channel.required or channel.role == "command":
            continue
        finite = np.isfinite(log[name])
        if recorded and _never_recorded(log, name):
            log = log.without(name).repaired(
                f"Channel {name} never changes although {channel.derivative_of} does: it was dropped."
            )
        elif not finite.any(axis=0).all():
            log = log.without(name).repaired(f"Channel {name} has a column without numbers and was dropped.")
        elif (share := 1.0 - finite.all(axis=1).mean()) > LARGEST_LOSS:
            log = log.without(name).repaired(
                f"Channel {name} has empty cells in {100 * share:.0f} % of the rows and was dropped."
            )
    bad = ~np.isfinite(log.t)
    worst, count = "time", int(bad.sum())
    for name, values in log.values.items():
        cells = ~np.isfinite(values)
        j = int(np.argmax(cells.sum(axis=0)))
        if cells[:, j].sum() > count:
            worst, count = f"{name} of {log.channels[name].parts[j]}", int(cells[:, j].sum())
        bad |= cells.any(axis=1)
    if not bad.any():
        return log
    if bad.mean() > LARGEST_LOSS:
        raise DataError(
            f"{bad.sum()} of {len(bad)} rows have empty, NaN or infinite cells, most in {worst} ({count})",
            where=log.source,
            next_step="Export the log again, with all channels at the same times.",
        )
    return without_rows(log, bad, f"with empty, NaN or infinite cells (most in {worst})")


def _never_recorded(log: Log, name: str) -> bool:
    """Whether a rate is constant in every part while its path moves: it was never filled."""
    path = log.channels[name].derivative_of
    return path in log and not np.ptp(log[name], axis=0).any() and bool(np.ptp(log[path], axis=0).any())


def order_rows(log: Log) -> Log:
    """Keeps the longest increasing sequence of times: drops repeated, jumping and decreasing time stamps.
    Rows in decreasing order of time are reversed.

    Raises:
        DataError: time restarts (two recordings in one file), too many stamps are out of order, or too many
            rows share theirs.
    """
    if len(log) > 1 and (np.diff(log.t) < 0).mean() > 1.0 - LARGEST_LOSS / 2:
        log = log.take(np.arange(len(log))[::-1])
        log = log.repaired("The times were in decreasing order, so the order of the rows was reversed.")
    log = _without_repeats(log)
    if len(log.t) < 2:
        raise DataError("the time never advances", where=log.source, next_step="Export the log again.")
    steps = np.diff(log.t)
    if (steps > 0).all():
        return _without_strays(log)
    keep = increasing_rows(log.t)
    lost = len(log.t) - len(keep)
    if lost > LARGEST_LOSS / 2 * len(log.t):
        back = int(np.argmin(steps)) + 1
        restart = (steps < 0).sum() <= 3 and steps.min() < -REWIND_SECONDS
        advice = (
            "Cut the file there, and ingest each recording separately." if restart else "Sort it by time."
        )
        fact = "time restarts" if restart else f"time runs backwards {(steps < 0).sum()} times, first"
        raise DataError(f"{fact} at row {back}", where=f"{log.source}, time column", next_step=advice)
    dropped = np.ones(len(log), dtype=np.bool_)
    dropped[keep] = False
    return _without_strays(without_rows(log, dropped, "whose time jumps or runs backwards"))


def _without_strays(log: Log) -> Log:
    """Drops a few rows whose times are further from the others than their duration: unset stamps, garbage."""
    pieces = segments(log.t)
    main = max(pieces, key=lambda piece: piece.stop - piece.start)
    first, last = log.t[main.start], log.t[main.stop - 1]
    far = (log.t < 2.0 * first - last) | (log.t > 2.0 * last - first)
    if not far.any() or far.mean() > RARE:
        return log
    return without_rows(log, far, f"far in time from all others (first at {log.t[far][0]:.6g} s)")


def _without_repeats(log: Log) -> Log:
    """Drops rows that repeat the time before. DataError: too many do, with other values."""
    repeats = np.concatenate([[False], np.diff(log.t) == 0])[: len(log)]
    if not repeats.any():
        return log
    new = np.zeros(len(log), dtype=np.bool_)
    for values in log.values.values():
        new[1:] |= (np.diff(values, axis=0) != 0.0).any(axis=1)
    if (repeats & new).mean() > LARGEST_LOSS and not repeats[1:].all():
        raise DataError(
            f"{(repeats & new).sum()} of {len(log)} rows have the time of the row before and other values: "
            "the times have too few digits",
            where=f"{log.source}, time column",
            next_step="Export the times with more digits (microseconds), or remove those rows.",
        )
    return without_rows(log, repeats, "with the time of the row before")


def increasing_rows(t: Array) -> Index:
    """Row numbers of a longest strictly increasing subsequence of t (T,) (patience sorting)."""
    tails: list[float] = []
    tail_rows: list[int] = []
    previous = np.full(len(t), -1)
    for row, value in enumerate(t.tolist()):
        place = bisect_left(tails, value)
        previous[row] = tail_rows[place - 1] if place else -1
        if place == len(tails):
            tails.append(value)
            tail_rows.append(row)
        else:
            tails[place], tail_rows[place] = value, row
    keep = []
    row = tail_rows[-1]
    while row >= 0:
        keep.append(row)
        row = int(previous[row])
    return np.array(keep[::-1], dtype=np.int64)


def note_pauses(log: Log) -> Log:
    """Reports pauses, which split the log; refuses a log that is mostly pauses."""
    pieces = segments(log.t)
    if len(pieces) == 1:
        return log
    starts = np.array([piece.start for piece in pieces[1:]])
    lengths = log.t[starts] - log.t[starts - 1]
    duration = log.t[-1] - log.t[0]
    if lengths.sum() > LARGEST_PAUSE * duration:
        raise DataError(
            f"samples are missing for {lengths.sum():.3g} of {duration:.3g} s, the longest pause after "
            f"t = {log.t[starts[np.argmax(lengths)] - 1]:.3f} s",
            where=f"{log.source}, time column",
            next_step="Record again, or cut the file to its continuous part.",
        )
    where = ", ".join(f"{log.t[s - 1]:.2f}" for s in starts[:5])
    more = ", ..." if len(starts) > 5 else ""
    return log.repaired(
        f"{len(starts)} pauses without samples (together {lengths.sum():.3g} s, after t = {where}{more} s) "
        "split the log.",
    )


WILD, FURTHER = (
    20.0,
    5.0,
)  # times the usual distance of rows from the mean of their neighbours; times large steps
FLICKER = 10.0  # times the least step: smaller jumps are an encoder between two counts


def drop_spikes(log: Log) -> Log:
    """Drops single rows far from both neighbours, where these agree."""
    wild = np.zeros(len(log), dtype=np.bool_)
    for channel in log.channels.values():
        if channel.role == "state" and channel.name in log and set(channel.units) <= {"rad", "m"}:
            for q in log[channel.name].T:
                wild[1:-1] |= _wild(q)
    if not wild.any() or wild.sum() > RARE * len(log):
        return log
    return without_rows(log, wild, "with a single outlier position")


def _wild(q: Array) -> Mask:
    """(T-2,) of the inner values of q (T,)."""
    if len(q) < 3:
        return np.zeros(0, dtype=np.bool_)
    off, step = np.abs(q[1:-1] - 0.5 * (q[:-2] + q[2:])), np.abs(np.diff(q))
    # 1.5: from a median to a deviation (1.48), about; twice the steps that all but one in twenty keep
    usual, large = 1.5 * float(np.median(off)), 2.0 * float(np.quantile(step, 0.95))
    quantum = float(np.min(step, where=step > 0.0, initial=np.inf))
    least = max(WILD * usual, FURTHER * large, FLICKER * quantum)
    # the rows beside a wild one are as near to each other as two steps, and a hundredth of how far it is off
    return np.asarray((off > least) & (np.abs(q[2:] - q[:-2]) < 2.0 * large + 1e-2 * off))


def check_leaps(log: Log, channels: Sequence[Channel], limits: Limits) -> Log:
    """The log. DataError: positions leap faster than the robot can move."""
    for channel in bounded(log, limits):
        top = top_speed(channel, channels, limits)
        if top is None:
            continue
        lower, upper = limits[channel.name]
        leap = leaps(log, channel, top, upper - lower)
        if leap.any():
            row, j = (int(k[0]) for k in np.nonzero(leap))
            fact, step = _jump_sentences(log, channel, row, j)
            raise DataError(fact, where=f"{log.source}, {channel.parts[j]}", next_step=step)
    return log


CHECK = "jump"
JUMP_FACTOR = 3.0  # times the velocity limit: larger steps are not motion
STEP_NOISE = 0.01  # part of a range: largest noise in a step
BESIDE = 10  # rows on both sides with which a leap is compared
ALONE = 5.0  # times the largest step beside: a clock in another unit makes all steps large
RARE_SHARE = 0.01  # of the rows


def leaps(log: Log, channel: Channel, top: Array, size: Array) -> Mask:
    """(T-1, k) True where the step is no motion: beyond the velocity limit and a hundredth of the range.

    Args:
        channel: of positions. top: (k,) its largest rates. size: (k,) its ranges.
    """
    steps, q = np.diff(log.t), log[channel.name]
    is_leap = np.empty((len(steps), q.shape[1]), dtype=bool)
    for j in range(q.shape[1]):  # one by one, since memory for all at once is missing with long logs
        is_leap[:, j] = np.abs(np.diff(q[:, j])) > JUMP_FACTOR * top[j] * steps + STEP_NOISE * size[j]
    return is_leap


def leap_finding(log: Log, channel: Channel, top: Array, size: Array) -> Finding | None:
    """Few positions that leap and stay, in a motion that is otherwise smooth; None if there are none.

    To be asked before velocities, commands and ranges, which one leap makes look wrong. Arguments as `leaps`.
    """
    # of positions in another unit the range is that of the log, not of the limits
    is_leap = leaps(log, channel, top, np.maximum(size, np.ptp(log[channel.name], axis=0)))
    for j in np.flatnonzero(is_leap.any(axis=0)).tolist():
        q = log[channel.name][:, j]
        is_leap[:, j] &= _is_isolated(np.diff(q)) & ~_is_spike(q, is_leap[:, j])
    rows = np.flatnonzero(is_leap.any(axis=1))
    if not len(rows) or len(rows) > max(RARE_SHARE * len(log), 1):
        return None
    row, j = int(rows[0]), int(np.argmax(is_leap[rows[0]]))
    fact, step = _jump_sentences(log, channel, row, j)
    where = f"{channel.parts[j]}: {fact}"
    margin = GAP_FACTOR * float(np.median(np.diff(log.t)))
    spans = tuple((float(log.t[r]) - margin, float(log.t[r + 1]) + margin) for r in rows[:BESIDE].tolist())
    return Finding(CHECK, "red", f"{where}.", step, spans=spans)


def _jump_sentences(log: Log, channel: Channel, row: int, j: int) -> tuple[str, str]:
    """Sentence on a leap after a row, and the next step."""
    q, unit = log[channel.name][:, j], channel.units[j]
    step = float(q[row + 1] - q[row])
    fact = f"the position jumps by {step:.3g} {unit} at t = {log.t[row]:.3f} s, faster than it can move"
    return fact, (
        "Possible causes: several recordings in one file, an encoder reset, another robot, or a wrong "
        "unit. Cut the file there, and ingest each part separately."
    )


def _is_isolated(step: Array) -> Mask:
    """(T-1,) where a step (T-1,) is far larger than those beside it, and than those of a coarse sensor."""
    size = np.abs(step)
    beside = np.full(len(size), np.median(size[size > 0.0]) if size.any() else 0.0)
    for k in range(1, min(BESIDE, len(size) - 1) + 1):
        beside[k:] = np.maximum(beside[k:], size[:-k])
        beside[:-k] = np.maximum(beside[:-k], size[k:])
    return np.asarray(size > ALONE * beside)


def _is_spike(q: Array, leap: Mask) -> Mask:
    """(T-1,) leaps out and back: single wild rows, which are dropped later."""
    is_back = np.zeros(len(leap), dtype=bool)
    both = leap[:-1] & leap[1:] & (np.diff(q)[:-1] * np.diff(q)[1:] < 0.0)
    is_back[:-1] |= both
    is_back[1:] |= both
    return is_back


def check_commanded(log: Log) -> Log:
    """The log. DataError: a moving joint has a constant command, which the plausibility checks cannot use."""
    for channel in [c for c in log.channels.values() if c.role == "command" and c.acts_on in log]:
        moved = np.ptp(log[channel.acts_on], axis=0) > 0
        dead = np.flatnonzero(moved & (np.ptp(log[channel.name], axis=0) == 0)).tolist()
        if dead:
            names = ", ".join(channel.parts[j] for j in dead)
            raise DataError(
                f"the command of {names} is constant although the joint moved: it was not recorded",
                where=log.source,
                next_step="Log this command, or remove the joint from the robot file.",
            )
    return log


def check_constant(log: Log) -> Log:
    """Refuses a log where nothing moved or a moving joint's command is constant; notes joints at rest.

    Raises:
        DataError: a commanded joint did not move, or a joint moved without a command.
    """
    for channel in [c for c in log.channels.values() if c.role == "command" and c.acts_on in log]:
        moved = np.ptp(log[channel.acts_on], axis=0) > 0
        if not moved.any():
            raise DataError(
                "nothing moved: every position column is constant",
                where=log.source,
                next_step="Record the motion itself, and check the position channel.",
            )
        log = check_commanded(log)
        for j in np.flatnonzero(~moved):
            log = log.repaired(f"{channel.parts[j]} did not move in this log.")
    return log
