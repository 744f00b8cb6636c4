"""Alignment of a log with its proposal: the start, and the deviation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude.errors import DataError
from etude.logs.checks.desired_motion import CLEAR_MATCH, COLUMNS, unlike
from etude.logs.cleaning.read import ending
from etude.logs.cleaning.smoothing import median_rate, resample, uniform_grid
from etude.logs.columns.units import start_at_zero
from etude.protocols import Trajectory
from etude.types import Array, Channel, Index, Log, Mask

BETTER = 0.5  # ratio of mismatches below which another start replaces that of a marked clock
PERFECT = 0.05  # mismatch below which a stop of the run is not tested
LIKELIER = 0.8  # ratio of the mismatches of a stopped and a whole run below which the stop is accepted
LONGEST_MARKED_LAG = 2.0  # s: up to this lag a clock with a marked 0 decides the start


REFINEMENTS, LARGEST_STEP = 20, 0.1  # Gauss-Newton steps towards the start, and the largest step, s
SETTLED = 1e-3  # part of a row: shorter steps end the iteration
ROWS = 2000  # rows on which starts are compared
WILD = 4.0  # squared deviation over the spread, beyond which all rows are equally wrong
# Cost of a second, over the proposal's duration: of the proposal that the log lacks, and at most of a row
# outside it that is not at rest in the first or last pose (an approach, a landing).
MISSING, OUTSIDE = 0.5, 0.5
TIE = 0.02  # difference of cost below which starts are equal, and that of the clock counts
LONGEST_LAG = 0.5  # s: largest lag of a controller that tracks


@dataclass(frozen=True)
class SampledPlan:
    """The proposal at the log's rate: values (S, k) from t = 0, at rest before and after; scale (k,)."""

    values: Array
    rate: float
    duration: float
    scale: Array

    @staticmethod
    def of(trajectory: Trajectory, rate: float, scale: Array) -> SampledPlan:
        count = int(np.ceil(trajectory.duration * rate)) + 1
        t = np.minimum(np.arange(count) / rate, trajectory.duration)
        values = trajectory.motion(t, 1).orders[0]
        return SampledPlan(values, rate, float(trajectory.duration), np.asarray(scale, dtype=np.float64))

    def at(self, t: Array) -> Array:
        """(T, k) at times t, by interpolation."""
        times = np.minimum(np.arange(len(self.values)) / self.rate, self.duration)
        return resample(times, self.values, t)

    def slope(self, t: Array) -> Array:
        """(T, k) the rate of change at times t, over a row to either side."""
        return (self.at(t + 1.0 / self.rate) - self.at(t - 1.0 / self.rate)) * (0.5 * self.rate)

    def inside(self, t: Array) -> Mask:
        half = 0.5 / self.rate
        return np.asarray((t >= -half) & (t <= self.duration + half))

    @property
    def spread(self) -> float:
        """Pooled standard deviation, in parts of the scale."""
        # 1e-12: a constant plan has no spread, and the division must be finite
        return max(float(np.linalg.norm((self.values / self.scale).std(axis=0))), 1e-12)


LEAST_OVERLAP = 0.4  # of the shorter signal: a shorter overlap fits well by chance
MOST_DELAYS = 64  # largest number of candidate delays
WORTH = 0.5  # part of the best correlation: least one of a candidate


@dataclass(frozen=True)
class Delay:
    """How far `response` lags behind `reference`.

    Attributes:
        seconds: the lag; positive when the response comes later.
        correlation: correlation coefficient of the two at that lag, over their overlap, in [-1, 1].
    """

    seconds: float
    correlation: float


def likely_delays(
    reference: Array, response: Array, rate: float, lags: tuple[float, float] = (-1.0, 1.0)
) -> list[Delay]:
    """The lags in `lags` (s) at which the columns of two signals (T, k) and (S, k) at `rate` Hz fit, best
    first: a motion that repeats itself fits at several.

    Both are differenced, so that offsets do not count, and scaled per column, so that units do not. The
    correlation coefficient over the overlap counts, which is at least LEAST_OVERLAP of the shorter signal; a
    parabola through three neighbours refines each lag below a sample. Signals may differ in length: row 0 of
    both is the same instant at lag 0.
    """
    a, b = _rates(reference), _rates(response)
    overlap = max(2, int(LEAST_OVERLAP * min(len(a), len(b))))
    low = max(int(np.floor(lags[0] * rate)), overlap - len(a))
    high = min(int(np.ceil(lags[1] * rate)), len(b) - overlap)
    shifts = np.arange(low, max(high, low) + 1)
    values = _correlations(a, b, shifts)
    padded = np.concatenate([[-np.inf], values, [-np.inf]])
    tops = np.flatnonzero((values >= padded[:-2]) & (values > padded[2:]))
    tops = tops[np.argsort(-values[tops], kind="stable")][:MOST_DELAYS]
    best = float(values[tops[0]])
    least = best - (1.0 - WORTH) * abs(best)  # the correlation is negative if nothing fits
    worth = [int(top) for top in tops if values[top] >= least]
    return [
        Delay(float((shifts[top] + _parabola_top(values, top)) / rate), float(values[top])) for top in worth
    ]


def _correlations(a: Array, b: Array, shifts: Index) -> Array:
    """Correlation coefficient of a[i] with b[i + shift] over their overlap, for each shift."""
    n = 1 << (len(a) + len(b)).bit_length()
    spectrum = np.conj(np.fft.rfft(a, n, axis=0)) * np.fft.rfft(b, n, axis=0)
    product = np.fft.irfft(spectrum.sum(axis=1), n)[shifts % n]
    start = np.maximum(0, -shifts)
    stop = np.minimum(len(a), len(b) - shifts)
    energy_a, energy_b = (np.concatenate([[0.0], np.cumsum((x * x).sum(axis=1))]) for x in (a, b))
    norm = (energy_a[stop] - energy_a[start]) * (energy_b[stop + shifts] - energy_b[start + shifts])
    values = product / np.sqrt(np.maximum(norm, np.finfo(float).tiny))
    return np.asarray(np.where(np.isfinite(values), values, -1.0))  # overflow of wild values


def _rates(values: Array) -> Array:
    rates = np.diff(values, axis=0)
    scale = rates.std(axis=0)
    return rates / np.where(scale > 0, scale, 1.0)


def _parabola_top(values: Array, best: int) -> float:
    if not 0 < best < len(values) - 1:
        return 0.0
    left, top, right = values[best - 1 : best + 2]
    bend = left - 2 * top + right
    return 0.0 if bend == 0 else float(0.5 * (left - right) / bend)


def best_start(t: Array, measured: Array, plan: SampledPlan, *, begun: bool = False) -> float:
    """The most likely start of the proposal by the log's clock, s.

    Args:
        begun: the log holds the proposal's start.
    """
    grid = uniform_grid(t, plan.rate)
    motion = resample(t, measured, grid)
    span = (-2.0 / plan.rate if begun else -plan.duration, float(grid[-1] - grid[0]))
    delays = likely_delays(plan.values, motion, plan.rate, span)
    few = np.unique(np.linspace(0, len(grid) - 1, ROWS).astype(np.int64))
    starts = _likely([float(t[0] + delay.seconds) for delay in delays], grid[few], motion[few], plan)
    # noise splits a peak into several: those near the clock's start count by their refined start
    led = [_refined(start, grid[few], motion[few], plan) for start in starts if abs(start) <= LONGEST_LAG]
    near = _likely([start for start in led if abs(start) <= LONGEST_LAG], grid[few], motion[few], plan)
    if near:
        return _refined(min(near, key=near.__getitem__), grid, motion, plan)
    # cost to six digits: of equal starts the nearest to that of the clock
    first = min(starts, key=lambda start: (round(starts[start], 6), abs(start - t[0])))
    return _refined(first, grid, motion, plan)


def _likely(starts: Sequence[float], t: Array, motion: Array, plan: SampledPlan) -> dict[float, float]:
    """Costs by start, of the starts whose cost equals that of the best."""
    costs = {start: _cost(t - start, motion, plan) for start in starts}
    least = min(costs.values(), default=0.0)
    return {start: cost for start, cost in costs.items() if cost <= least + TIE}


def _refined(start: float, t: Array, motion: Array, plan: SampledPlan) -> float:
    """The nearby start with the least deviation of positions (T, k), without offsets; rates would amplify
    noise.
    """
    for _ in range(REFINEMENTS):
        inside = plan.inside(t - start)
        if inside.sum() < 3:
            break
        planned, slope = plan.at(t[inside] - start) / plan.scale, plan.slope(t[inside] - start) / plan.scale
        error = motion[inside] / plan.scale - planned
        error = error - error.mean(axis=0)
        slope = slope - slope.mean(axis=0)
        # no step where the plan is at rest
        step = -float((error * slope).sum()) / max(float((slope * slope).sum()), 1e-300)
        start += float(np.clip(step, -LARGEST_STEP, LARGEST_STEP))
        if abs(step) < SETTLED / plan.rate:
            break
    return start


def _cost(t: Array, motion: Array, plan: SampledPlan) -> float:
    """Mismatch of a motion (T, k) with the proposal, at its evenly spaced times t, over the whole log."""
    deviation = (((motion - plan.at(t)) / plan.scale) ** 2).sum(axis=1) / plan.spread**2
    inside = plan.inside(t)
    step = float(t[-1] - t[0]) / (len(t) - 1)
    wrong = np.minimum(deviation[inside], WILD).sum() * step
    restless = np.minimum(deviation[~inside], 1.0).sum() * step
    missing = plan.duration - covered_seconds(t, plan.duration)
    return float(wrong + OUTSIDE * restless + MISSING * missing) / plan.duration


def covered_seconds(t: Array, duration: float) -> float:
    """Seconds of the proposal between the first and the last of times t."""
    return max(0.0, min(float(t[-1]), duration) - max(float(t[0]), 0.0))


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

    Candidate starts, from correlation, are compared over the whole log: the motion must follow the proposal
    inside it and rest outside, and little of the proposal may be missing. Of equally good starts (a periodic
    proposal) that of the log's clock counts. A controller's lag does not shift a clock that begins and ends
    with the proposal, or marks its 0 by negative times. Otherwise the lag is part of the start, unless the
    log has the planned motion. All coordinates count together, in parts of `scale`, since one joint may be
    stuck. Without the channel `path` the clock of the log must start with the trajectory.

    A stopped run has the start of the proposal and some seconds more; rows at rest after the stop are cut. It
    may have less than half of the proposal, but must follow it closely; `holds_enough` decides whether it
    answers it. A log that ends before its proposal gets a sentence.

    Args:
        channels: of the robot; the plan is `<path>_des` and its derivatives.
        path: the channel that is compared with the trajectory.
        scale: (k,) sizes of its coordinates.
        rest: rows before and after the trajectory are kept.

    Raises:
        DataError: the motion is another one, or less than half of it is in the log and not its start.
    """
    if path not in log:
        return ended(start_at_zero(log), trajectory.duration)
    plan = SampledPlan.of(trajectory, median_rate(log.t), scale)
    if log[path].shape[1] != plan.values.shape[1]:
        raise DataError(
            f"the log has {log[path].shape[1]} coordinates, the proposal {plan.values.shape[1]}",
            where=log.source,
            next_step="Tell a log of this robot.",
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
    return with_plan(ended(aligned, plan.duration), trajectory, channels, path)


def holds_enough(log: Log, duration: float) -> bool:
    """Whether an aligned log has enough of its proposal, s, to answer it."""
    return covered_seconds(log.t, duration) >= LEAST_COVERAGE * duration


@dataclass(frozen=True)
class _Aligned:
    """A log by the proposal's clock, and its mismatch."""

    log: Log
    mismatch: float


# Root mean square deviation over the proposal's own spread. A weak controller against stiction reaches 0.8 on
# a small motion, other motions of the same kind begin at 0.9; up to 0.5 there is no doubt.
LARGEST_MISMATCH = 0.85
# Of so few coordinates other motions that repeat themselves fit better by chance, from 0.42 on; in positions
# and rates alike a third as often. Below a mismatch of 0.4 rates are not asked for: noise and a robot that
# leaves out what is quick spoil them first.
FEW, LARGEST_OF_FEW, CLEAR_OF_FEW = 3, 0.7, 0.4
LEAST_COVERAGE = 0.5  # part of the proposal that the log must contain
STRIDE = 0.01  # part of the proposal over which rates are taken: noise is small over such a stride


@dataclass(frozen=True)
class Overlap:
    """Measured and planned motion, at the log's times within the proposal.

    Attributes:
        motion, planned: (n, k).
        pooled: their root mean square deviation over the proposal's spread, in parts of the scale.
        each: (k,) the same for each coordinate.
        rates: the same of their rates, pooled; NaN of too few rows to tell.
    """

    motion: Array
    planned: Array
    pooled: float
    each: Array
    rates: float

    @staticmethod
    def of(t: Array, measured: Array, plan: SampledPlan) -> Overlap:
        """t: (T,) s of the proposal, at the plan's rate. measured: (T, k)."""
        inside = plan.inside(t)
        motion, planned = measured[inside], plan.at(t[inside])
        if not inside.any():
            return Overlap(motion, planned, np.inf, np.full(len(plan.scale), np.inf), np.nan)
        error = np.sqrt((((motion - planned) / plan.scale) ** 2).mean(axis=0))
        # a coordinate at rest has no spread to compare with
        spread = np.maximum((planned / plan.scale).std(axis=0), 1e-12)
        pooled = float(np.linalg.norm(error) / np.linalg.norm(spread))
        return Overlap(motion, planned, pooled, error / spread, _rate_error(motion, planned, plan))

    @property
    def mismatch(self) -> float:
        """Pooled; of few coordinates, in doubt, the larger of positions' and rates': slow harmonics look
        alike in position.
        """
        doubtful = self.motion.shape[1] <= FEW and self.pooled > CLEAR_OF_FEW
        return float(np.fmax(self.pooled, self.rates)) if doubtful else self.pooled


def allowed(coverage: float, coordinates: int) -> float:
    """The largest mismatch of a log with that part of the proposal: a short part may fit by chance."""
    largest = LARGEST_OF_FEW if coordinates <= FEW else LARGEST_MISMATCH
    lacking = min(max((1.0 - coverage) / (1.0 - LEAST_COVERAGE), 0.0), 1.0)
    return largest - (largest - CLEAR_MATCH) * lacking


def _rate_error(motion: Array, planned: Array, plan: SampledPlan) -> float:
    """Deviation of the rates of change over a stride, relative to the planned rates."""
    rows = max(1, round(STRIDE * plan.duration * plan.rate))
    if len(motion) <= 2 * rows:
        return np.nan
    made, ordered = ((values[rows:] - values[:-rows]) / plan.scale for values in (motion, planned))
    # a plan at rest is followed by any log at rest
    return float(np.linalg.norm(made - ordered) / max(float(np.linalg.norm(ordered)), 1e-12))


def _whole(log: Log, measured: Array, plan: SampledPlan, path: str) -> tuple[_Aligned, DataError | None]:
    """The log at its most likely start, and the error if it has another motion."""
    best = best_start(log.t, measured, plan)
    shifted, unshifted = (Overlap.of(log.t - start, measured, plan) for start in (best, 0.0))
    start = 0.0 if _clock_holds(log.t, plan, best, shifted.pooled, unshifted.pooled) else best
    aligned = _Aligned(_moved(log, start), shifted.pooled)
    covered = covered_seconds(log.t - best, plan.duration)
    try:
        largest = allowed(covered / plan.duration, len(plan.scale))
        _check_match(shifted, unshifted, largest, log.channels[path].parts, log)
        _check_coverage(aligned.log, plan.duration)
    except DataError as error:
        return aligned, error
    return aligned, None


RESTING = 0.01  # part of the scale within which a coordinate stays at rest
LEFT = 0.05  # part of the scale by which the plan continues after a stop
LEAST_STANDSTILL = 0.5  # s of rest that are longer than a turning point of the motion
LEAST_S = 5.0  # part of the proposal that a stopped run must have
CLOSE = 0.3  # largest mismatch of a part: a short one fits by chance
INSTANTS = 200  # points of the rest of a plan at which it is compared
AT_START = 0.05  # part of the scale within which the robot waits for the start


def standstill(t: Array, measured: Array, scale: Array) -> float:
    """Time of the last stop of the motion (T, k), s; the end of the log if it never stops."""
    last = np.median(measured[-max(3, len(t) // 100) :], axis=0)
    away = np.flatnonzero((np.abs(measured - last) / scale).max(axis=1) > RESTING)
    if not len(away):
        return float(t[0])
    stop = float(t[away[-1]])
    return stop if t[-1] - stop >= LEAST_STANDSTILL else float(t[-1])


def goes_on_without(stop: float, end: float, plan: SampledPlan) -> bool:
    """Whether the plan moves on after the run's stop at time `stop` of it, or the recording ends there."""
    if stop >= plan.duration:
        return False
    if end - stop < LEAST_STANDSTILL:
        return True
    planned = plan.at(np.linspace(stop, min(plan.duration, end), INSTANTS))
    return bool((np.abs(planned - planned[0]) / plan.scale).max() > LEFT)


def waits_at_start(t: Array, measured: Array, plan: SampledPlan) -> bool:
    """Whether the rows before the proposal rest at its start, and there are rows where it starts."""
    before = measured[t < 0.0]
    if t[0] > 2.0 / plan.rate:
        return False
    away = np.abs(before - plan.values[0]) / plan.scale
    # 99 % of the rows: single wild values are dropped later
    return not len(before) or bool(np.quantile(away.max(axis=1), 0.99) <= AT_START)


def ended(log: Log, duration: float) -> Log:
    """The log, with a sentence if it ends before its proposal; t = 0 is the start of the proposal."""
    last = float(log.t[-1])
    if duration - last < LEAST_STANDSTILL:
        return log
    return log.repaired(
        f"The log ends at {last:.1f} s of the proposal's {duration:.4g} s, {duration - last:.1f} s before "
        "its end: only this part is used."
    )


def _stopped(log: Log, measured: Array, plan: SampledPlan, path: str) -> _Aligned | None:
    """The run up to its stop; None if it did not stop, or does not follow the proposal closely."""
    stop = standstill(log.t, measured, plan.scale)
    cut = log.t <= stop
    if stop - log.t[0] < LEAST_S:
        return None
    t, motion = log.t[cut], measured[cut]
    best = best_start(t, motion, plan, begun=True)
    overlap, unshifted = (Overlap.of(t - start, motion, plan) for start in (best, 0.0))
    held = _clock_holds(log.t, plan, best, overlap.pooled, unshifted.pooled) and unshifted.pooled <= CLOSE
    start, mismatch = (0.0, unshifted.pooled) if held else (best, overlap.pooled)
    strange = _cause(unshifted if held else overlap, log.channels[path].parts)
    follows = mismatch <= CLOSE and not strange and waits_at_start(t - start, motion, plan)
    if not follows or stop - start < LEAST_S or not goes_on_without(stop - start, log.t[-1] - start, plan):
        return None
    moved = _moved(log, start)
    return _Aligned(moved.take(moved.t <= stop - start), mismatch)


def _moved(log: Log, start: float) -> Log:
    """The log with t = 0 at the start, and a sentence if it was shifted."""
    if start == 0.0:
        return log
    sentence = f"The proposal starts {start:.3f} s after the start of the log; t = 0 was moved there."
    return replace(log, t=log.t - start).repaired(sentence)


def _clock_holds(t: Array, plan: SampledPlan, best: float, shifted: float, unshifted: float) -> bool:
    """Whether the log's clock starts with the proposal, so that the remaining shift is the controller's lag.

    Args:
        best: the start that fits best, s; shifted: the mismatch there.
        unshifted: the mismatch by the log's clock.
    """
    step = 1.0 / plan.rate
    if abs(best) <= 0.5 * step:
        return True
    if t[0] < -0.5 * step:
        # a lag larger than LONGEST_LAG also deforms the motion; otherwise the clock is wrong
        longest = LONGEST_LAG if shifted <= PERFECT else LONGEST_MARKED_LAG
        late = -2.0 * step <= best <= longest
        return unshifted <= LARGEST_MISMATCH and (late or shifted > BETTER * unshifted)
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
    step = "Ingest the log of this proposal, or state the number of the proposal that was run."
    raise DataError(
        f"this is not the log of the proposed trajectory: {what} from it by {by:.2g} times its spread{cause}",
        where=log.source,
        next_step=f"{COLUMNS} {step}" if cause else step,
    )


CAUSES = {
    "opposite": "{own} moves in the opposite direction (sign?)",
    "degrees": "{own} looks like degrees",
    "exchanged": "{own} follows the proposal for {other} (exchanged?)",
}


def _cause(overlap: Overlap, parts: Sequence[str]) -> str:
    """Text on the likely cause (sign, degrees, exchanged joints), for the first coordinate with one."""
    for odd in unlike(overlap.motion, overlap.planned, overlap.each):
        return "; " + CAUSES[odd.kind].format(own=parts[odd.coordinate], other=parts[odd.other])
    return ""


def _check_coverage(log: Log, duration: float) -> None:
    covered = covered_seconds(log.t, duration)
    if not holds_enough(log, duration):
        raise DataError(
            f"the log holds {covered:.3g} of the proposal's {duration:.3g} s, or another motion. "
            f"{ending(log)}".rstrip(" ."),
            where=log.source,
            next_step="Ingest a log of the whole proposal. If the motion was interrupted, run it again, "
            "slower if the robot hit something.",
        )


def with_plan(log: Log, trajectory: Trajectory, channels: Sequence[Channel], path: str) -> Log:
    """The log with the exact planned motion at its times; before and after the motion, planned rates are
    0.
    """
    by_name = {c.name: c for c in channels}
    first = f"{path}_des"
    measured = log.channels[path]
    plans = [by_name.get(first, Channel(first, measured.parts, measured.units, "plan"))]
    while len(plans) < 3 and (rates := [c for c in channels if c.derivative_of == plans[-1].name]):
        plans.append(rates[0])
    t = np.clip(log.t, 0.0, trajectory.duration)
    orders = trajectory.motion(t, len(plans)).orders
    # 1 ns: rounding must not place the last row outside
    outside = np.abs(log.t - t) > 1e-9
    for order, channel in enumerate(plans):
        values = orders[order] if order == 0 else np.where(outside[:, None], 0.0, orders[order])
        log = log.put(channel, np.ascontiguousarray(values))
    return log
