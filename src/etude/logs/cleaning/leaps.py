"""Positions of joints that leap: further from one row to the next than the joint can move."""

from __future__ import annotations

import numpy as np

from etude.logs.cleaning.smoothing import GAP_FACTOR
from etude.types import Array, Channel, Finding, Log, Mask

CHECK = "jump"
JUMP_FACTOR = 3.0  # a step of more than this many velocity limits is no motion
ROOM = 0.01  # of a range: what noise may add to a step
BESIDE = 10  # rows to either side that a leap is held against
ALONE = 5.0  # times the largest step beside: a clock in another unit makes all steps large
FEW = 0.01  # of the rows
TURN = 0.2  # rad within which a leap is one turn


def leaps(log: Log, channel: Channel, top: Array, size: Array) -> Mask:
    """(T-1, k) True where the step is no motion: beyond the velocity limit and a hundredth of the range.

    Args:
        channel: of positions. top: (k,) its largest rates. size: (k,) its ranges.
    """
    steps, q = np.diff(log.t), log[channel.name]
    found = np.empty((len(steps), q.shape[1]), dtype=bool)
    for j in range(q.shape[1]):  # one by one: long logs leave no room for all at once
        found[:, j] = np.abs(np.diff(q[:, j])) > JUMP_FACTOR * top[j] * steps + ROOM * size[j]
    return found


def leap_finding(log: Log, channel: Channel, top: Array, size: Array) -> Finding | None:
    """Few positions that leap and stay, in a motion that is otherwise smooth; None if there are none.

    To be asked before velocities, commands and ranges, which one leap makes look wrong. Arguments as `leaps`.
    """
    # of positions in another unit the range is that of the log, not of the limits
    found = leaps(log, channel, top, np.maximum(size, np.ptp(log[channel.name], axis=0)))
    for j in np.flatnonzero(found.any(axis=0)).tolist():
        found[:, j] &= _alone(np.diff(log[channel.name][:, j])) & ~_back(log[channel.name][:, j], found[:, j])
    rows = np.flatnonzero(found.any(axis=1))
    if not len(rows) or len(rows) > max(FEW * len(log), 1):
        return None
    row, j = int(rows[0]), int(np.argmax(found[rows[0]]))
    fact, step = told(log, channel, row, j)
    where = f"{channel.parts[j]}: {fact}"
    spare = GAP_FACTOR * float(np.median(np.diff(log.t)))
    spans = tuple((float(log.t[r]) - spare, float(log.t[r + 1]) + spare) for r in rows[:BESIDE].tolist())
    return Finding(CHECK, "red", f"{where}.", step, spans=spans)


def told(log: Log, channel: Channel, row: int, j: int) -> tuple[str, str]:
    """What is said of a leap after a row, and the next step."""
    q, unit = log[channel.name][:, j], channel.units[j]
    step = float(q[row + 1] - q[row])
    fact = f"the position jumps by {step:.3g} {unit} at t = {log.t[row]:.3f} s, faster than it can move"
    if unit == "rad" and abs(abs(step) - 2 * np.pi) < TURN:
        return fact, "Unwrap the angle (it jumps by one turn)."
    return fact, (
        "Is this several recordings in one file, an encoder that was set anew, another robot, or a wrong "
        "unit? Cut the file there, and tell each part on its own."
    )


def _alone(step: Array) -> Mask:
    """(T-1,) where a step (T-1,) is far larger than those beside it, and than those of a coarse sensor."""
    size = np.abs(step)
    beside = np.full(len(size), np.median(size[size > 0.0]) if size.any() else 0.0)
    for k in range(1, min(BESIDE, len(size) - 1) + 1):
        beside[k:] = np.maximum(beside[k:], size[:-k])
        beside[:-k] = np.maximum(beside[:-k], size[k:])
    return np.asarray(size > ALONE * beside)


def _back(q: Array, leap: Mask) -> Mask:
    """(T-1,) leaps out and back: single wild rows, which are dropped later."""
    found = np.zeros(len(leap), dtype=bool)
    both = leap[:-1] & leap[1:] & (np.diff(q)[:-1] * np.diff(q)[1:] < 0.0)
    found[:-1] |= both
    found[1:] |= both
    return found
