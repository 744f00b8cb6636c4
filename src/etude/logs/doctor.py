"""Repairs of rows: what is dropped, and when a log is refused instead. Nothing is interpolated here.

Each repair adds one sentence to `RobotLog.repairs`.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError
from etude.logs.smoothing import segments
from etude.logs.log import RobotLog
from etude.logs.parquet import CHANNELS
from etude.robots.spec import RobotSpec

Array = NDArray[np.float64]

LARGEST_LOSS = 0.2  # of the rows may be unusable; beyond it the log is refused
LARGEST_PAUSE = 0.5  # of the log's duration may be missing in pauses
JUMP_FACTOR = 3.0  # a step of more than this many velocity limits is no motion
REWIND_SECONDS = 1.0  # time that falls back further, and stays there, is a second recording


def take_rows(log: RobotLog, index: NDArray[np.int64] | NDArray[np.bool_]) -> RobotLog:
    """The log's rows at `index`, in all channels."""
    kept = {c: getattr(log, c)[index] for c in CHANNELS if getattr(log, c) is not None}
    return replace(log, t=log.t[index], **kept)


def add_repair(log: RobotLog, sentence: str) -> RobotLog:
    """The log with one more repair on record."""
    return replace(log, repairs=(*log.repairs, sentence))


def drop_unreadable(log: RobotLog) -> RobotLog:
    """Drops optional channels without a single number, then rows with an empty, NaN or infinite cell."""
    for channel in CHANNELS[2:]:
        values = getattr(log, channel)
        if values is not None and not np.isfinite(values).any(axis=0).all():
            kept = {c: getattr(log, c) for c in CHANNELS[2:] if c != channel}
            log = replace(log, **{**kept, channel: None})
            log = add_repair(log, f"Channel {channel} has a column without numbers and was dropped.")
    bad = ~np.isfinite(log.t)
    worst, count = "time", int(bad.sum())
    for channel in CHANNELS:
        values = getattr(log, channel)
        if values is not None:
            cells = ~np.isfinite(values)
            j = int(np.argmax(cells.sum(axis=0)))
            if cells[:, j].sum() > count:
                worst, count = f"{channel} of joint {log.names[j]}", int(cells[:, j].sum())
            bad |= cells.any(axis=1)
    if not bad.any():
        return log
    if bad.mean() > LARGEST_LOSS:
        raise DataError(
            f"{bad.sum()} of {len(bad)} rows have empty, NaN or infinite cells, most in {worst} ({count})",
            where=log.source,
            next_step="Export the log again, with all channels at the same times.",
        )
    return add_repair(
        take_rows(log, ~bad),
        f"{bad.sum()} rows with empty, NaN or infinite cells (most in {worst}) were dropped.",
    )


def order_rows(log: RobotLog) -> RobotLog:
    """Keeps the longest run of rows whose time increases: drops repeats, and stamps that jump or run back.

    Raises:
        DataError: time restarts (two recordings in one file), or too many stamps are out of order.
    """
    repeats = np.concatenate([[False], np.diff(log.t) == 0])
    if repeats.any():
        log = add_repair(
            take_rows(log, ~repeats), f"{repeats.sum()} rows that repeat the time before were dropped."
        )
    if len(log.t) < 2:
        raise DataError("the time never advances", where=log.source, next_step="Export the log again.")
    steps = np.diff(log.t)
    if (steps > 0).all():
        return log
    keep = increasing_rows(log.t)
    lost = len(log.t) - len(keep)
    if lost > LARGEST_LOSS / 2 * len(log.t):
        back = int(np.argmin(steps)) + 1
        restart = (steps < 0).sum() <= 3 and steps.min() < -REWIND_SECONDS
        advice = "Cut the file there, and tell each recording on its own." if restart else "Sort it by time."
        fact = "time restarts" if restart else f"time runs backwards {(steps < 0).sum()} times, first"
        raise DataError(f"{fact} at row {back}", where=f"{log.source}, time column", next_step=advice)
    return add_repair(take_rows(log, keep), f"{lost} rows whose time jumps or runs backwards were dropped.")


def increasing_rows(t: Array) -> NDArray[np.int64]:
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


def note_pauses(log: RobotLog) -> RobotLog:
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
    return add_repair(
        log,
        f"{len(starts)} pauses without samples (together {lengths.sum():.3g} s, after t = {where}{more} s) "
        "split the log.",
    )


def drop_spikes(log: RobotLog, spec: RobotSpec) -> RobotLog:
    """Drops single rows in which a position leaps out and back faster than the joint can move."""
    leap = _leaps(log, spec)
    rows = np.flatnonzero(leap.any(axis=1))
    spikes = rows[np.isin(rows + 1, rows)] + 1
    # The row between a leap out and a leap back; a run of leaps is no single spike and stays.
    if len(spikes) and len(spikes) <= 0.01 * len(log.t):
        keep = np.ones(len(log.t), dtype=bool)
        keep[spikes] = False
        log = add_repair(
            take_rows(log, keep), f"{len(spikes)} rows with a single wild position were dropped."
        )
        leap = _leaps(log, spec)
    if leap.any():
        row, j = (int(k[0]) for k in np.nonzero(leap))
        size = log.q[row + 1, j] - log.q[row, j]
        turn = abs(abs(size) - 2 * np.pi) < 0.2
        raise DataError(
            f"the position jumps by {size:.3g} rad at t = {log.t[row]:.3f} s, faster than the joint can move",
            where=f"{log.source}, joint {log.names[j]}",
            next_step="Unwrap the angle (it jumps by one turn)."
            if turn
            else "Is this several recordings in one file, another robot, or a wrong unit?",
        )
    return log


def _leaps(log: RobotLog, spec: RobotSpec) -> NDArray[np.bool_]:
    """(T-1, dof) True where the step is no motion: beyond the velocity limit and a hundredth of the range."""
    steps = np.diff(log.t)[:, None]
    allowed = JUMP_FACTOR * spec.velocity * steps + 0.01 * (spec.upper - spec.lower)
    return np.asarray(np.abs(np.diff(log.q, axis=0)) > allowed)


def check_constant(log: RobotLog) -> RobotLog:
    """Refuses a log where nothing moved or a moving joint's command is constant; notes joints at rest."""
    moved = np.ptp(log.q, axis=0) > 0
    commanded = np.ptp(log.tau, axis=0) > 0
    if not moved.any():
        raise DataError(
            "no joint moved: every position column is constant",
            where=log.source,
            next_step="Record the motion itself, and check the position channel.",
        )
    for j in np.flatnonzero(moved & ~commanded):
        raise DataError(
            f"the command is constant ({log.tau[0, j]:g}) although the joint moved",
            where=f"{log.source}, joint {log.names[j]}",
            next_step="Log this joint's command, or leave the joint out of the robot file.",
        )
    for j in np.flatnonzero(~moved):
        log = add_repair(log, f"Joint {log.names[j]} did not move in this log.")
    return log
