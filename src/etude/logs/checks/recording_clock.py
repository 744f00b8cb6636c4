"""Rows and times of a log as they were read: rate, jitter, gaps, repeats, a clock that jumps."""

from __future__ import annotations

import numpy as np

from etude.logs.cleaning.smoothing import GAP_FACTOR
from etude.types import Array, Finding, Log, Mask

JITTER = 0.5  # of a step, in 95 % of the rows: beyond, linear interpolation starts to bend the motion
REPEATED = 0.01  # of the rows
STANDS = 20  # equal rows in a run: that is rest
SLOWEST, FASTEST = 2.0, 5e4  # rows a second that a robot's recorder writes
SPANS = 50  # that are marked


def clock_findings(log: Log) -> tuple[Finding, ...]:
    """What the times say, row by row as they were recorded; times may be of any order, or missing."""
    known = np.isfinite(log.t)
    if known.sum() < 2 or not (np.diff(log.t[known]) > 0).any():
        return (
            Finding("rate", "red", "The log has no two rows at different times.", "Export the log again."),
        )
    log = log.take(known)
    steps = np.diff(log.t)
    forward = steps[steps > 0]
    step = float(np.median(forward))
    return (_rate(forward, step), _order(log.t, steps), _gaps(log.t, steps, step), _repeats(log, steps))


def _rate(forward: Array, step: float) -> Finding:
    spread = float(np.quantile(np.abs(forward / step - 1.0), 0.95))
    said = f"{1.0 / step:.4g} rows a second; 95 % of the steps within {100.0 * spread:.2g} % of {step:.4g} s."
    if not SLOWEST < 1.0 / step < FASTEST:
        return Finding("rate", "yellow", said, "No robot is recorded so: are the times in another unit?")
    if spread < JITTER:
        return Finding("rate", "green", said)
    return Finding(
        "rate", "yellow", said, "Log at a fixed rate, or take the stamps of the sensor, not the host's."
    )


def _order(t: Array, steps: Array) -> Finding:
    back = np.flatnonzero(steps < 0)
    if not len(back):
        return Finding("order", "green", "Time never runs backwards.")
    spans = tuple((float(t[k + 1]), float(t[k])) for k in back[:SPANS])
    return Finding(
        "order",
        "yellow" if len(back) < 0.01 * len(t) else "red",
        f"Time runs backwards at {len(back)} row{'s'[: len(back) > 1]}, first at row {back[0] + 1}, "
        f"by {-steps[back[0]]:.3g} s.",
        "Rows out of order are dropped; cut the file where a second recording begins.",
        spans=spans,
    )


def _gaps(t: Array, steps: Array, step: float) -> Finding:
    gaps = np.flatnonzero(steps > GAP_FACTOR * step)
    if not len(gaps):
        return Finding("gaps", "green", f"No pause is longer than {GAP_FACTOR:g} steps.")
    lost = float(steps[gaps].sum())
    share = lost / max(float(t.max() - t.min()), step)
    return Finding(
        "gaps",
        "red" if share > 0.5 else "yellow",
        f"{len(gaps)} pause{'s'[: len(gaps) > 1]} without samples, together {lost:.3g} s, the longest "
        f"{steps[gaps].max():.3g} s.",
        "Pauses split the log; a slower rate or another recorder loses fewer rows.",
        spans=tuple((float(t[k]), float(t[k + 1])) for k in gaps[:SPANS]),
    )


def _repeats(log: Log, steps: Array) -> Finding:
    """Rows at the time of the row before, and rows whose every cell is that of the row before."""
    same_time, same = float((steps == 0).mean()), float(_held(log).mean())
    said = (
        f"{100 * same_time:.3g} % of the rows repeat the time before, {100 * same:.3g} % repeat all values."
    )
    if max(same_time, same) < REPEATED:
        return Finding("repeats", "green", said)
    return Finding(
        "repeats",
        "yellow",
        said,
        "The recorder is faster than the sensor: log at the sensor's rate. Repeated times are dropped.",
    )


def _held(log: Log) -> Mask:
    """(T-1,) rows in which nothing has changed, but for rest: runs of fewer than STANDS."""
    same = np.ones(max(len(log) - 1, 0), dtype=np.bool_)
    moved = False
    for name, values in log.values.items():
        if log.channels[name].role in ("state", "aside"):
            varying = np.ptp(np.nan_to_num(values), axis=0) > 0
            moved = moved or bool(varying.any())
            same &= (values[1:, varying] == values[:-1, varying]).all(axis=1)
    if not moved or not len(same):
        return np.zeros_like(same)
    edges = np.flatnonzero(np.diff(same, prepend=~same[0], append=~same[-1]))
    return np.asarray(same & (np.repeat(np.diff(edges), np.diff(edges)) < STANDS))
