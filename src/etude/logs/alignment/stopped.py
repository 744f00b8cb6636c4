"""A run that was stopped: the robot follows the proposal for a while, then rests, or the recording ends."""

from __future__ import annotations

import numpy as np

from etude.logs.alignment.starts import Plan
from etude.types import Array, Log

RESTING = 0.01  # part of the scale within which a coordinate stays at rest
LEFT = 0.05  # part of the scale by which the plan goes on after a stop
LEAST_STANDSTILL = 0.5  # s of rest that are no turning point of the motion
LEAST_S = 5.0  # of the proposal that a stopped run has to hold
CLOSE = 0.3  # largest mismatch of a part: a short one fits by chance
INSTANTS = 200
AT_START = 0.05  # part of the scale within which the robot waits for the start


def standstill(t: Array, measured: Array, scale: Array) -> float:
    """When the motion (T, k) came to its last rest, s; the end of the log if it never does."""
    last = np.median(measured[-max(3, len(t) // 100) :], axis=0)
    away = np.flatnonzero((np.abs(measured - last) / scale).max(axis=1) > RESTING)
    if not len(away):
        return float(t[0])
    stop = float(t[away[-1]])
    return stop if t[-1] - stop >= LEAST_STANDSTILL else float(t[-1])


def goes_on_without(stop: float, end: float, plan: Plan) -> bool:
    """Whether the plan moves on after the run's stop at time `stop` of it, or the recording ends there."""
    if stop >= plan.duration:
        return False
    if end - stop < LEAST_STANDSTILL:
        return True
    wanted = plan.at(np.linspace(stop, min(plan.duration, end), INSTANTS))
    return bool((np.abs(wanted - wanted[0]) / plan.scale).max() > LEFT)


def waits_at_start(t: Array, measured: Array, plan: Plan) -> bool:
    """Whether the rows before the proposal rest at its start, and there are rows where it starts."""
    before = measured[t < 0.0]
    if t[0] > 2.0 / plan.rate:
        return False
    away = np.abs(before - plan.values[0]) / plan.scale
    return not len(before) or bool(np.quantile(away.max(axis=1), 0.99) <= AT_START)


def ended(log: Log, duration: float) -> Log:
    """The log, with a sentence where it ends before its proposal does; t = 0 is where that starts."""
    last = float(log.t[-1])
    if duration - last < LEAST_STANDSTILL:
        return log
    return log.repaired(
        f"The log ends at {last:.1f} s of the proposal's {duration:.4g} s, {duration - last:.1f} s before it "
        "does: it teaches up to there."
    )
