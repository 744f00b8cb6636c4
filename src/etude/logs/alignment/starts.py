"""At which time of a log its trajectory starts most likely; one that repeats itself fits at several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from etude.logs.alignment.delay import likely_delays
from etude.logs.cleaning.smoothing import resample, uniform_grid
from etude.protocols import Trajectory
from etude.types import Array, Mask

REFINEMENTS, LARGEST_STEP = 20, 0.1  # steps of Gauss and Newton towards the start, and s of each at most
SETTLED = 1e-3  # of a row: a shorter step is none
ROWS = 2000  # on which starts are compared
WILD = 4.0  # squared deviation over the spread, beyond which all rows are equally wrong
# Cost of a second, over the proposal's duration: of the proposal that the log lacks, and at most of a row
# outside it that is not at rest in the first or last pose (an approach, a landing).
MISSING, OUTSIDE = 0.5, 0.5
TIE = 0.02  # of cost: starts that cannot be told apart, of which the clock's own counts
LONGEST_LAG = 0.5  # s: no controller that tracks lags more


@dataclass(frozen=True)
class Plan:
    """The proposal at the log's rate: values (S, k) from t = 0, in rest before and after; scale (k,)."""

    values: Array
    rate: float
    duration: float
    scale: Array

    @staticmethod
    def of(trajectory: Trajectory, rate: float, scale: Array) -> Plan:
        count = int(np.ceil(trajectory.duration * rate)) + 1
        t = np.minimum(np.arange(count) / rate, trajectory.duration)
        values = trajectory.motion(t, 1).orders[0]
        return Plan(values, rate, float(trajectory.duration), np.asarray(scale, dtype=np.float64))

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
        return max(float(np.linalg.norm((self.values / self.scale).std(axis=0))), 1e-12)


def best_start(t: Array, measured: Array, plan: Plan, *, begun: bool = False) -> float:
    """The time in the log's clock at which the proposal starts most likely, s.

    Args:
        begun: the log holds the proposal's start.
    """
    grid = uniform_grid(t, plan.rate)
    motion = resample(t, measured, grid)
    span = (-2.0 / plan.rate if begun else -plan.duration, float(grid[-1] - grid[0]))
    delays = likely_delays(plan.values, motion, plan.rate, span)
    few = np.unique(np.linspace(0, len(grid) - 1, ROWS).astype(np.int64))
    starts = _likely([float(t[0] + delay.seconds) for delay in delays], grid[few], motion[few], plan)
    # noise makes several tops of one: those near the clock's own start count by where they lead
    led = [_refined(start, grid[few], motion[few], plan) for start in starts if abs(start) <= LONGEST_LAG]
    near = _likely([start for start in led if abs(start) <= LONGEST_LAG], grid[few], motion[few], plan)
    if near:
        return _refined(min(near, key=near.__getitem__), grid, motion, plan)
    first = min(starts, key=lambda start: (round(starts[start], 6), abs(start - t[0])))
    return _refined(first, grid, motion, plan)


def _likely(starts: Sequence[float], t: Array, motion: Array, plan: Plan) -> dict[float, float]:
    """Costs by start of those that cannot be told from the best."""
    costs = {start: _cost(t - start, motion, plan) for start in starts}
    least = min(costs.values(), default=0.0)
    return {start: cost for start, cost in costs.items() if cost <= least + TIE}


def _refined(start: float, t: Array, motion: Array, plan: Plan) -> float:
    """The start nearby at which the positions (T, k) deviate least, offsets apart: rates weigh noise."""
    for _ in range(REFINEMENTS):
        inside = plan.inside(t - start)
        if inside.sum() < 3:
            break
        wanted, slope = plan.at(t[inside] - start) / plan.scale, plan.slope(t[inside] - start) / plan.scale
        error = motion[inside] / plan.scale - wanted
        error = error - error.mean(axis=0)
        slope = slope - slope.mean(axis=0)
        step = -float((error * slope).sum()) / max(float((slope * slope).sum()), 1e-300)
        start += float(np.clip(step, -LARGEST_STEP, LARGEST_STEP))
        if abs(step) < SETTLED / plan.rate:
            break
    return start


def _cost(t: Array, motion: Array, plan: Plan) -> float:
    """How badly a motion (T, k) at times t of the proposal, evenly spaced, fits it over the whole log."""
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
