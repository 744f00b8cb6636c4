"""Drives that are off: no joint moves, and nothing is commanded. Gravity is then held by a brake."""

from __future__ import annotations

import numpy as np

from etude.logs.checks.filtered_motion import runs
from etude.types import Array, Channel, Finding, Log, Mask

CHECK = "brake"
WINDOW_S = 0.5
STILL = 1e-3  # rad or m: by which positions differ in a window
IDLE = 1e-3  # of the limit: commands that are none
LEAST_S = 1.0  # s: between two moves a drive may well have nothing to do


def brake_finding(log: Log, command: Channel, limit: Array) -> Finding:
    """Stretches with drives off, which would teach that a pose takes no command.

    Args:
        log: with positions and the commands that act on them.
        limit: (J,) how far each command reaches.
    """
    off, edges = _off(log, command, limit)
    spans = _spans(off, edges)
    if not spans:
        return Finding(CHECK, "green", "Where the robot stands, something is commanded.")
    if off.all():
        fact = "Throughout the log no joint moves and nothing is commanded: brakes on, or drives off."
        return Finding(CHECK, "red", fact, "Release the brakes and record a motion.")
    seconds = sum(end - start for start, end in spans)
    return Finding(
        CHECK,
        "yellow",
        f"For {seconds:.3g} s no joint moves and nothing is commanded: brakes on, or drives off.",
        f"That is cut, unless told with --accept {CHECK}.",
        spans=spans,
    )


def without_spans(log: Log, finding: Finding) -> Log:
    """The log less the finding's spans; what is left has pauses there."""
    kept = np.ones(len(log), dtype=np.bool_)
    for start, end in finding.spans:
        kept &= (log.t < start) | (log.t >= end)
    return log.take(kept).repaired(f"{finding.sentence} That was cut.")


def _off(log: Log, command: Channel, limit: Array) -> tuple[Mask, Array]:
    """Of each window, whether the drives are off; and its edges (w + 1,) s."""
    number = ((log.t - log.t[0]) / WINDOW_S).astype(np.int64)
    first = np.flatnonzero(np.diff(number, prepend=-1))
    q, u = log[command.acts_on], np.abs(log[command.name])
    size = np.maximum.reduceat(q, first) - np.minimum.reduceat(q, first)
    still = (size < STILL).all(axis=1)
    idle = (np.maximum.reduceat(u, first) <= IDLE * limit).all(axis=1)
    off = np.asarray(still & idle)
    return off, np.append(log.t[first], np.nextafter(log.t[-1], np.inf))


def _spans(off: Mask, edges: Array) -> tuple[tuple[float, float], ...]:
    found = [(float(edges[a]), float(edges[b])) for a, b in runs(off)]
    return tuple((start, end) for start, end in found if end - start >= LEAST_S)
