"""Is this the log of that trajectory? Alignment of a log with the proposal it claims to follow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude.contracts import Array, Channel, Log, Mask, Trajectory
from etude.errors import DataError
from etude.logs.delay import likely_delays
from etude.logs.read import ending
from etude.logs.smoothing import median_rate, resample, uniform_grid
from etude.logs.units import start_at_zero

# Root mean square deviation over the proposal's own spread. A weak controller against stiction reaches 0.8 on
# a small motion, other motions of the same kind begin at 0.9; up to 0.5 there is no doubt.
LARGEST_MISMATCH = 0.85
CLEAR_MATCH = 0.5
ALIKE = 0.9  # correlation of two motions that are the same but for sign, unit or name
LEAST_COVERAGE = 0.5  # part of the proposal that the log has to contain
ROWS = 2000  # on which starts are compared
WILD = 4.0  # squared deviation over the spread, beyond which all rows are equally wrong
# Cost of a second, over the proposal's duration: of the proposal that the log lacks, and at most of a row
# outside it that is not at rest in the first or last pose (an approach, a landing).
MISSING, OUTSIDE = 1.0, 0.5
TIE = 0.02  # of cost: starts that cannot be told apart, of which the clock's own counts
BETTER = 0.5  # mismatch over that of a marked clock, with which another start is believed instead
LONGEST_LAG = 0.5  # s: no controller that tracks lags more
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

    Args:
        channels: the robot's; its plan is `<path>_des`, and what is its derivative.
        path: the channel that is compared with the trajectory.
        scale: (k,) sizes of its coordinates.
        rest: rows before and after the trajectory are kept.

    Raises:
        DataError: the motion is another one, or less than half of it is in the log.
    """
    if path not in log:
        return start_at_zero(log)
    plan = _Plan.of(trajectory, median_rate(log.t), scale)
    if log[path].shape[1] != plan.values.shape[1]:
        raise DataError(
            f"the log has {log[path].shape[1]} coordinates, the proposal {plan.values.shape[1]}",
            where=log.source,
        )
    measured = log[path] if f"{path}_des" not in log else log[f"{path}_des"]
    best = _best_start(log.t, measured, plan)
    shifted, own = (_Overlap.of(log.t - start, measured, plan) for start in (best, 0.0))
    start = 0.0 if _clock_holds(log.t, plan, best, shifted.pooled, own.pooled) else best
    _check_match(shifted, own, log.channels[path].parts, log)
    aligned = log if start == 0.0 else replace(log, t=log.t - start)
    _check_coverage(aligned, plan.duration)
    half = 0.5 / plan.rate
    if not rest:
        aligned = aligned.take((aligned.t >= -half) & (aligned.t <= plan.duration + half))
    aligned = _with_plan(aligned, trajectory, channels, path)
    if start == 0.0:
        return aligned
    return aligned.repaired(f"The proposal starts {start:.3f} s into the log's time; t = 0 was moved there.")


@dataclass(frozen=True)
class _Plan:
    """The proposal at the log's rate: values (S, k) from t = 0, in rest before and after; scale (k,)."""

    values: Array
    rate: float
    duration: float
    scale: Array

    @staticmethod
    def of(trajectory: Trajectory, rate: float, scale: Array) -> _Plan:
        count = int(np.ceil(trajectory.duration * rate)) + 1
        t = np.minimum(np.arange(count) / rate, trajectory.duration)
        values = trajectory.motion(t, 1).orders[0]
        return _Plan(values, rate, float(trajectory.duration), np.asarray(scale, dtype=np.float64))

    def at(self, t: Array) -> Array:
        """(T, k) at times t, by interpolation."""
        times = np.minimum(np.arange(len(self.values)) / self.rate, self.duration)
        return resample(times, self.values, t)

    def inside(self, t: Array) -> Mask:
        half = 0.5 / self.rate
        return np.asarray((t >= -half) & (t <= self.duration + half))

    @property
    def spread(self) -> float:
        """Pooled standard deviation, in parts of the scale."""
        return max(float(np.linalg.norm((self.values / self.scale).std(axis=0))), 1e-12)


def _best_start(t: Array, measured: Array, plan: _Plan) -> float:
    """The time in the log's clock at which the proposal starts most likely, s."""
    grid = uniform_grid(t, plan.rate)
    motion = resample(t, measured, grid)
    span = (-plan.duration, float(grid[-1] - grid[0]))
    delays = likely_delays(plan.values, motion, plan.rate, span)
    starts = [float(t[0] + delay.seconds) for delay in delays]
    few = np.unique(np.linspace(0, len(grid) - 1, ROWS).astype(np.int64))
    costs = [_cost(grid[few] - start, motion[few], plan) for start in starts]
    likely = [start for start, cost in zip(starts, costs, strict=True) if cost <= min(costs) + TIE]
    near = [start for start in likely if abs(start) <= LONGEST_LAG]
    if near:
        return min(near, key=lambda start: costs[starts.index(start)])
    return min(likely, key=lambda start: (round(costs[starts.index(start)], 6), abs(start - t[0])))


def _cost(t: Array, motion: Array, plan: _Plan) -> float:
    """How badly a motion (T, k) at times t of the proposal, evenly spaced, fits it over the whole log."""
    deviation = (((motion - plan.at(t)) / plan.scale) ** 2).sum(axis=1) / plan.spread**2
    inside = plan.inside(t)
    step = float(t[-1] - t[0]) / (len(t) - 1)
    wrong = np.minimum(deviation[inside], WILD).sum() * step
    restless = np.minimum(deviation[~inside], 1.0).sum() * step
    covered = max(0.0, min(float(t[-1]), plan.duration) - max(float(t[0]), 0.0))
    return float(wrong + OUTSIDE * restless + MISSING * (plan.duration - covered)) / plan.duration


def _clock_holds(t: Array, plan: _Plan, best: float, shifted: float, own: float) -> bool:
    """Whether the log's clock starts with the proposal, so that what is left is the controller's lag.

    Args:
        best: the start that fits best, s; shifted: the mismatch there.
        own: the mismatch by the log's clock.
    """
    step = 1.0 / plan.rate
    if abs(best) <= 0.5 * step:
        return True
    if t[0] < -0.5 * step:
        late = -2.0 * step <= best <= LONGEST_MARKED_LAG
        return own <= LARGEST_MISMATCH and (late or shifted > BETTER * own)
    spans = abs(t[0]) <= 1.5 * step and abs(t[-1] - plan.duration) <= 2.5 * step
    return spans and -2.0 * step <= best <= LONGEST_LAG


@dataclass(frozen=True)
class _Overlap:
    """motion, wanted (n, k) at the log's times within the proposal; their root mean square deviation over
    the proposal's spread, pooled in parts of the scale and for each coordinate.
    """

    motion: Array
    wanted: Array
    pooled: float
    each: Array

    @staticmethod
    def of(t: Array, measured: Array, plan: _Plan) -> _Overlap:
        inside = plan.inside(t)
        motion, wanted = measured[inside], plan.at(t[inside])
        if not inside.any():
            return _Overlap(motion, wanted, np.inf, np.full(len(plan.scale), np.inf))
        error = np.sqrt((((motion - wanted) / plan.scale) ** 2).mean(axis=0))
        spread = np.maximum((wanted / plan.scale).std(axis=0), 1e-12)
        return _Overlap(motion, wanted, float(np.linalg.norm(error) / np.linalg.norm(spread)), error / spread)


def _check_match(best: _Overlap, unshifted: _Overlap, parts: Sequence[str], log: Log) -> None:
    """Refuses another motion. A wrong sign or order spoils the alignment; the log's own clock may show it."""
    cause = _cause(best, parts)
    if best.pooled > CLEAR_MATCH and not cause:
        cause = _cause(unshifted, parts)
    if best.pooled <= LARGEST_MISMATCH and not cause:
        return
    raise DataError(
        "this is not the log of the proposed trajectory: the motion deviates from it by "
        f"{best.pooled:.2g} times its spread{cause}",
        where=log.source,
        next_step="Tell the log of this proposal, or the number of the proposal that was run.",
    )


def _cause(overlap: _Overlap, parts: Sequence[str]) -> str:
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
    covered = min(float(log.t[-1]), duration) - max(float(log.t[0]), 0.0)
    if covered < LEAST_COVERAGE * duration:
        raise DataError(
            f"the log holds {max(covered, 0.0):.3g} of the proposal's {duration:.3g} s, or another motion. "
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
