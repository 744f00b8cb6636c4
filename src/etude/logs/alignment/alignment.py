"""Is this the log of that trajectory? Alignment of a log with the proposal it claims to follow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude.errors import DataError
from etude.logs.alignment.overlap import CLEAR_MATCH, LARGEST_MISMATCH, LEAST_COVERAGE, Overlap, allowed
from etude.logs.alignment.starts import LONGEST_LAG, Plan, best_start, covered_seconds
from etude.logs.alignment.stopped import CLOSE, LEAST_S, ended, goes_on_without, standstill, waits_at_start
from etude.logs.cleaning.read import ending
from etude.logs.cleaning.smoothing import median_rate
from etude.logs.columns.units import start_at_zero
from etude.protocols import Trajectory
from etude.types import Array, Channel, Log

ALIKE = 0.9  # correlation of two motions that are the same but for sign, unit or name
BETTER = 0.5  # mismatch over that of a marked clock, with which another start is believed instead
PERFECT = 0.05  # mismatch below which nobody asks whether the run was stopped
LIKELIER = 0.8  # mismatch of a stopped run over that of a whole one, with which the stop is believed
LONGEST_MARKED_LAG = 2.0  # s: a clock that marks its 0 is believed over a robot that follows late


def align(
    log: Log,
    trajectory: Trajectory,
    channels: Sequence[Channel],
    path: str,
    scale: Array,
    *,
    rest: bool = True,
) -> Log:
    """The log with t = 0 at the trajectory's start and the planned motion filled in.

    Starts at which the recorded motion correlates with the proposal are compared over the whole log: inside
    the proposal it has to follow, outside to rest, and as little of the proposal as possible may be missing.
    Of starts that fit alike (the proposal repeats itself) the one of the log's own clock counts, and what a
    controller lags is no shift of a clock that begins and ends with the proposal, or marks its 0 by negative
    times. Otherwise the lag counts into the start, unless the log has the planned motion. The motion is
    judged over all coordinates together, in parts of `scale`: one joint alone may be stuck. A log without
    the channel `path` is taken at its word: its clock then has to start with the trajectory.

    A run that was stopped holds the proposal's start and some seconds more; what was recorded at rest after
    that is cut. It may hold less than half of the proposal, and has to follow it closely; whether it then
    `holds_enough` to answer it is another question. A log that ends before its proposal says so.

    Args:
        channels: the robot's; its plan is `<path>_des`, and what is its derivative.
        path: the channel that is compared with the trajectory.
        scale: (k,) sizes of its coordinates.
        rest: rows before and after the trajectory are kept.

    Raises:
        DataError: the motion is another one, or less than half of it is in the log and not its start.
    """
    if path not in log:
        return ended(start_at_zero(log), trajectory.duration)
    plan = Plan.of(trajectory, median_rate(log.t), scale)
    if log[path].shape[1] != plan.values.shape[1]:
        raise DataError(
            f"the log has {log[path].shape[1]} coordinates, the proposal {plan.values.shape[1]}",
            where=log.source,
        )
    measured = log[path] if f"{path}_des" not in log else log[f"{path}_des"]
    whole, refused = _whole(log, measured, plan, path)
    stopped = _stopped(log, measured, plan, path) if refused or whole.mismatch > PERFECT else None
    if stopped is not None and (refused or stopped.mismatch < LIKELIER * whole.mismatch):
        aligned = stopped.log
    elif refused is not None:
        raise refused
    else:
        aligned = whole.log
    half = 0.5 / plan.rate
    if not rest:
        aligned = aligned.take((aligned.t >= -half) & (aligned.t <= plan.duration + half))
    return _with_plan(ended(aligned, plan.duration), trajectory, channels, path)


def holds_enough(log: Log, duration: float) -> bool:
    """Whether an aligned log holds as much of its proposal, s, as answers it."""
    return covered_seconds(log.t, duration) >= LEAST_COVERAGE * duration


@dataclass(frozen=True)
class _Aligned:
    """A log by the proposal's clock, and how badly it fits."""

    log: Log
    mismatch: float


def _whole(log: Log, measured: Array, plan: Plan, path: str) -> tuple[_Aligned, DataError | None]:
    """The log at its likeliest start, and why it is not the proposal's, if it is not."""
    best = best_start(log.t, measured, plan)
    shifted, own = (Overlap.of(log.t - start, measured, plan) for start in (best, 0.0))
    start = 0.0 if _clock_holds(log.t, plan, best, shifted.pooled, own.pooled) else best
    aligned = _Aligned(_moved(log, start), shifted.pooled)
    covered = covered_seconds(log.t - best, plan.duration)
    try:
        _check_match(
            shifted, own, allowed(covered / plan.duration, len(plan.scale)), log.channels[path].parts, log
        )
        _check_coverage(aligned.log, plan.duration)
    except DataError as error:
        return aligned, error
    return aligned, None


def _stopped(log: Log, measured: Array, plan: Plan, path: str) -> _Aligned | None:
    """The run up to where it stopped; None if it did not, or does not follow the proposal closely so far."""
    stop = standstill(log.t, measured, plan.scale)
    cut = log.t <= stop
    if stop - log.t[0] < LEAST_S:
        return None
    t, motion = log.t[cut], measured[cut]
    best = best_start(t, motion, plan, begun=True)
    overlap, own = (Overlap.of(t - start, motion, plan) for start in (best, 0.0))
    held = _clock_holds(log.t, plan, best, overlap.pooled, own.pooled) and own.pooled <= CLOSE
    start, mismatch = (0.0, own.pooled) if held else (best, overlap.pooled)
    strange = _cause(own if held else overlap, log.channels[path].parts)
    follows = mismatch <= CLOSE and not strange and waits_at_start(t - start, motion, plan)
    if not follows or stop - start < LEAST_S or not goes_on_without(stop - start, log.t[-1] - start, plan):
        return None
    moved = _moved(log, start)
    return _Aligned(moved.take(moved.t <= stop - start), mismatch)


def _moved(log: Log, start: float) -> Log:
    """The log with t = 0 at the start, and a sentence if it was elsewhere."""
    if start == 0.0:
        return log
    sentence = f"The proposal starts {start:.3f} s into the log's time; t = 0 was moved there."
    return replace(log, t=log.t - start).repaired(sentence)


def _clock_holds(t: Array, plan: Plan, best: float, shifted: float, own: float) -> bool:
    """Whether the log's clock starts with the proposal, so that what is left is the controller's lag.

    Args:
        best: the start that fits best, s; shifted: the mismatch there.
        own: the mismatch by the log's clock.
    """
    step = 1.0 / plan.rate
    if abs(best) <= 0.5 * step:
        return True
    if t[0] < -0.5 * step:
        # a robot that follows later than any that tracks also deforms the motion; else its clock is wrong
        longest = LONGEST_LAG if shifted <= PERFECT else LONGEST_MARKED_LAG
        late = -2.0 * step <= best <= longest
        return own <= LARGEST_MISMATCH and (late or shifted > BETTER * own)
    over = float(t[-1]) - plan.duration
    # a recorder that was started with the proposal also ends with it; one that began a little early ends late
    spans = abs(t[0]) <= 1.5 * step and abs(over) <= 2.5 * step and abs(over) <= abs(over - best)
    return spans and -2.0 * step <= best <= LONGEST_LAG


def _check_match(best: Overlap, unshifted: Overlap, most: float, parts: Sequence[str], log: Log) -> None:
    """Refuses another motion. A wrong sign or order spoils the alignment; the log's own clock may show it."""
    cause = _cause(best, parts)
    if best.pooled > CLEAR_MATCH and not cause:
        cause = _cause(unshifted, parts)
    if best.mismatch <= most and not cause:
        return
    what = "the motion deviates" if best.pooled > most or cause else "its rates deviate"
    by = best.pooled if best.pooled > most or cause else best.mismatch
    raise DataError(
        f"this is not the log of the proposed trajectory: {what} from it by {by:.2g} times its spread{cause}",
        where=log.source,
        next_step="Tell the log of this proposal, or the number of the proposal that was run.",
    )


def _cause(overlap: Overlap, parts: Sequence[str]) -> str:
    """A guess in words (sign, degrees, exchanged joints) for the first coordinate that has one."""
    if len(overlap.motion) < 2:
        return ""
    a, b = (values - values.mean(axis=0) for values in (overlap.motion, overlap.wanted))
    norms = np.outer(np.sqrt((a * a).sum(axis=0)), np.sqrt((b * b).sum(axis=0))) + 1e-300
    likeness = (a.T @ b) / norms
    slope = (a * b).sum(axis=0) / ((b * b).sum(axis=0) + 1e-300)
    for j in np.flatnonzero(overlap.each > CLEAR_MATCH).tolist():
        other = int(np.argmax(likeness[j]))
        if likeness[j, j] < -ALIKE:
            return f"; {parts[j]} moves in the opposite direction (sign?)"
        if likeness[j, j] > ALIKE and 40 < slope[j] < 80:
            return f"; {parts[j]} looks like degrees"
        if likeness[j, j] < 0.5 and likeness[j, other] > ALIKE:
            return f"; {parts[j]} does what was proposed for {parts[other]} (exchanged?)"
    return ""


def _check_coverage(log: Log, duration: float) -> None:
    covered = covered_seconds(log.t, duration)
    if not holds_enough(log, duration):
        raise DataError(
            f"the log holds {covered:.3g} of the proposal's {duration:.3g} s, or another motion. "
            f"{ending(log)}".rstrip(" ."),
            where=log.source,
            next_step="Tell the log of this proposal, recorded from start to end; if it broke off, run it "
            "again, gentler if it hit something.",
        )


def _with_plan(log: Log, trajectory: Trajectory, channels: Sequence[Channel], path: str) -> Log:
    """The exact planned motion at the log's times; before and after, a trajectory rests."""
    known = {c.name: c for c in channels}
    first = f"{path}_des"
    own = log.channels[path]
    plans = [known.get(first, Channel(first, own.parts, own.units, "plan"))]
    while len(plans) < 3 and (rates := [c for c in channels if c.derivative_of == plans[-1].name]):
        plans.append(rates[0])
    t = np.clip(log.t, 0.0, trajectory.duration)
    orders = trajectory.motion(t, len(plans)).orders
    outside = np.abs(log.t - t) > 1e-9
    for order, channel in enumerate(plans):
        values = orders[order] if order == 0 else np.where(outside[:, None], 0.0, orders[order])
        log = log.put(channel, np.ascontiguousarray(values))
    return log
