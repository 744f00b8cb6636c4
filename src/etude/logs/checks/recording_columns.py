"""Columns of a log: dead ones, empty ones, coarse ones, saturated commands, positions that leap."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.logs.checks.recording_clock import SPANS
from etude.logs.cleaning.smoothing import GAP_FACTOR
from etude.logs.columns.units import Limits
from etude.types import Array, Channel, Finding, Index, Log, Mask

COARSE = 1e-3  # of a part's range: a step of the sensor that a filter cannot make up for
DISTINCT = 0.5  # of the rows hold values of their own: finer than the file can tell
SATURATED = 0.01  # of the rows at an extreme
AT_EDGE = 1e-3  # of the range
NOT_FILLED = "Was it recorded? Leave it out of the log if nobody filled it."
EMPTY = 0.2  # of the rows: a log that lacks more of what is needed is refused
LEAPS = 30.0  # times the step that 99 % of the rows stay below


def column_findings(log: Log, limits: Limits) -> tuple[Finding, ...]:
    """What each column says by itself; rows in order, cells may be empty. A raw column may be one that no
    robot needs: an empty one is no reason to refuse the log.
    """
    return (_dead(log), _empty(log), _coarse(log), _saturated(log, limits), _leaping(log))


def judged(log: Log) -> list[Channel]:
    """The channels that are measured or commanded."""
    return [c for n, c in log.channels.items() if c.role in ("state", "command", "aside") and n in log]


def label(channel: Channel, j: int) -> str:
    """ "q of elbow"; a raw column is its own name."""
    return f"{channel.name} of {channel.parts[j]}" if channel.parts[j] else channel.name


def _listed(names: Sequence[str], most: int = 8) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _dead(log: Log) -> Finding:
    dead, worse, still = [], [], False
    for channel in judged(log):
        values = log[channel.name]
        for j in np.flatnonzero((_range(values) == 0.0) & np.isfinite(values).any(axis=0)).tolist():
            dead.append(label(channel, j))
            still |= channel.role == "state"
            moves = channel.acts_on in log and _range(log[channel.acts_on])[j] > 0.0
            worse += [label(channel, j)] if channel.role == "command" and moves else []
    if worse:
        fact = f"{_listed(worse)} never changes although its joint moves."
        return Finding("dead", "red", fact, "Log this command, or leave the joint out of the robot file.")
    if dead:
        fact = f"Never changing: {_listed(dead)}."
        step = "A joint that stands teaches its gravity and friction only." if still else NOT_FILLED
        return Finding("dead", "yellow", fact, step)
    return Finding("dead", "green", "Every column changes.")


def _range(values: Array) -> Array:
    """(k,) of the finite cells; 0 of a column without."""
    finite = np.where(np.isfinite(values), values, np.nan)
    with np.errstate(all="ignore"):
        top, low = np.fmax.reduce(finite, axis=0), np.fmin.reduce(finite, axis=0)
    return np.asarray(np.nan_to_num(top - low))


def _empty(log: Log) -> Finding:
    shares, needed = {}, 0.0
    for channel in judged(log):
        for j, share in enumerate((1.0 - np.isfinite(log[channel.name]).mean(axis=0)).tolist()):
            if share > 0.0:
                shares[label(channel, j)] = share
                needed = max(needed, share if channel.parts[j] else 0.0)
    if not shares:
        return Finding("empty", "green", "Every cell holds a number.")
    worst = max(shares, key=lambda name: shares[name])
    some = "1 column has" if len(shares) == 1 else f"{len(shares)} columns have"
    return Finding(
        "empty",
        "red" if needed > EMPTY else "yellow",
        f"{some} empty or infinite cells, most {worst}: {100 * shares[worst]:.3g} %.",
        "Such rows are dropped, of a column that is needed; export all channels at the same times.",
    )


def _coarse(log: Log) -> Finding:
    steps = {}
    for channel in [c for c in judged(log) if c.role == "state" or not c.parts[0]]:
        for j in range(len(channel.parts)):
            quantum, size = resolution(log[channel.name][:, j])
            if quantum > 0.0:
                steps[label(channel, j)] = quantum / size
    if not steps:
        return Finding("quantisation", "green", "No column shows the steps of its sensor.")
    worst = max(steps, key=lambda name: steps[name])
    said = f"The coarsest column is {worst}: its range is {1.0 / steps[worst]:.3g} steps of the sensor."
    if steps[worst] < COARSE:
        return Finding("quantisation", "green", said)
    step = "Write more digits; if the encoder is so coarse, move further and faster."
    return Finding("quantisation", "yellow", said, step)


def resolution(values: Array) -> tuple[float, float]:
    """The step in which the values (T,) come, and their range; a step of 0 where none is seen."""
    finite = values[np.isfinite(values)]
    distinct = np.unique(finite)
    if len(distinct) < 2 or len(distinct) > DISTINCT * len(finite):
        return 0.0, 1.0
    size = float(distinct[-1] - distinct[0])
    steps = np.diff(distinct)
    return float(np.median(steps[steps > 1e-9 * size])), size


def _saturated(log: Log, limits: Limits) -> Finding:
    marked, shares = np.zeros(len(log), dtype=np.bool_), {}
    for channel in [c for c in judged(log) if c.role == "command"]:
        at = _at_edge(log[channel.name], channel, limits)
        for j in np.flatnonzero(at.mean(axis=0) > SATURATED).tolist():
            shares[label(channel, j)] = float(at[:, j].mean())
            marked |= at[:, j]
    if not shares:
        return Finding("saturation", "green", "No command stays at an extreme.")
    said = ", ".join(f"{name} for {100 * share:.3g} %" for name, share in shares.items())
    return Finding(
        "saturation",
        "yellow",
        f"Commands stay at an extreme: {said} of the time.",
        "There the command says little of the motion: run it gentler.",
        spans=spans_of(log.t, np.flatnonzero(marked)),
    )


def _at_edge(values: Array, channel: Channel, limits: Limits) -> Mask:
    """(T, k) at the stated limits, or at an extreme of the log that is held for two rows or more."""
    low, high = np.nanmin(values, axis=0, initial=np.inf), np.nanmax(values, axis=0, initial=-np.inf)
    near = AT_EDGE * (high - low)
    edge = ((values >= high - near) | (values <= low + near)) & (high > low)
    held = edge & (np.roll(edge, 1, axis=0) | np.roll(edge, -1, axis=0))
    held &= np.isclose(values, np.roll(values, 1, axis=0)) | np.isclose(values, np.roll(values, -1, axis=0))
    if channel.name in limits:
        lower, upper = limits[channel.name]
        held |= (values >= upper) | (values <= lower)
    return np.asarray(held)


def _leaping(log: Log) -> Finding:
    rows: list[int] = []
    names = []
    between = np.diff(log.t)
    pause = between > GAP_FACTOR * np.median(between) if len(between) else between > 0.0
    for channel in [c for c in judged(log) if c.role == "state" and not c.derivative_of]:
        step = np.nan_to_num(np.abs(np.diff(log[channel.name], axis=0)))
        usual = np.quantile(step, 0.99, axis=0) if len(step) else np.zeros(len(channel.parts))
        step[pause] = 0.0
        leaps = (step > LEAPS * usual) & (step > 1e-2 * _range(log[channel.name])) & (usual > 0.0)
        names += [label(channel, j) for j in np.flatnonzero(leaps.any(axis=0)).tolist()]
        rows += np.flatnonzero(leaps.any(axis=1)).tolist()
    if not rows:
        return Finding("jumps", "green", "No position leaps.")
    return Finding(
        "jumps",
        "yellow",
        f"{_listed(names)} leaps {len(rows)} time{'s'[: len(rows) > 1]}, first at {log.t[rows[0]]:.3g} s.",
        "Single wild rows are dropped; unwrap angles, and cut the file where another recording begins.",
        spans=spans_of(log.t, np.array(sorted(set(rows)))),
    )


def spans_of(t: Array, rows: Index) -> tuple[tuple[float, float], ...]:
    """Stretches of time (s) that neighbouring rows make."""
    if not len(rows):
        return ()
    pieces = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    last = len(t) - 1
    return tuple((float(t[p[0]]), float(t[min(int(p[-1]) + 1, last)])) for p in pieces[:SPANS])
