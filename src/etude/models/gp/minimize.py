"""Conjugate gradients with Rasmussen's line search, as GPML's `minimize`, which the thesis uses.

Polak-Ribière directions; each line search extrapolates by cubics until the minimum is bracketed, then
interpolates (quadratic while the far end lies above the start, cubic otherwise) until the Wolfe-Powell
conditions hold.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from etude.errors import NumericalError, UsageError
from etude.types import Array

Objective = Callable[[Array], tuple[float, Array]]

MARGIN = 0.1  # a new step stays this fraction of the bracket away from its ends
STRETCH = 3.0  # an extrapolated step is at most this many times the last one
PER_SEARCH = 20  # evaluations allowed in one line search
SLOPE_RATIO = 10.0  # the first step of a search grows at most so much over the last one
CURVATURE = 0.1  # Wolfe-Powell: the slope must shrink to this fraction of the start's ...
DECREASE = 0.05  # ... and the value must fall by at least this fraction of what the slope promised


@dataclass(frozen=True)
class Minimum:
    """The best point, its value, the evaluations used, and the value after each line search."""

    x: Array
    value: float
    evaluations: int
    history: tuple[float, ...]


@dataclass(frozen=True)
class _Probe:
    """One evaluation along a search line."""

    step: float
    value: float
    slope: float
    x: Array
    gradient: Array


def minimize(objective: Objective, start: Array, length: int, *, first_step: float = 1.0) -> Minimum:
    """Minimise a smooth function from `start` (P,).

    Args:
        objective: x (P,) -> value, gradient (P,). Where it is not finite the search steps back.
        length: positive: number of line searches; negative: number of function evaluations.
        first_step: expected decrease of the first search (GPML's `red`).

    Raises:
        UsageError: `length` is 0.
        NumericalError: the objective is not finite at `start`.
    """
    if length == 0:
        raise UsageError("length 0: give line searches (positive) or function evaluations (negative)")
    search = _Search(objective, budget=-length if length < 0 else None)
    here = search.begin(np.asarray(start, dtype=float))
    direction = -here.gradient
    slope = -float(direction @ direction)
    step, failed, history = first_step / (1.0 - slope), False, [here.value]
    while slope < 0.0 and search.left() > 0 and (length < 0 or len(history) <= length):
        accepted, best = search.along(here, direction, slope, step)
        old_slope, old = slope, here
        here = accepted or best
        history.append(here.value)
        if accepted is not None:
            direction = _polak_ribiere(old.gradient, here.gradient, direction)
            slope, failed = float(here.gradient @ direction), False
            if slope > 0.0:
                direction = -here.gradient
                slope = -float(direction @ direction)
            step = accepted.step * min(SLOPE_RATIO, old_slope / (slope - np.finfo(float).tiny))
        elif failed:
            break  # twice in a row, the second time along the steepest descent
        else:
            direction = -here.gradient
            slope = -float(direction @ direction)
            step, failed = 1.0 / (1.0 - slope), True
    return Minimum(here.x, here.value, search.evaluations, tuple(history))


def _polak_ribiere(old: Array, new: Array, direction: Array) -> Array:
    return np.asarray((new @ new - old @ new) / (old @ old) * direction - new)


@dataclass
class _Search:
    """Line searches on one objective, counting its evaluations."""

    objective: Objective
    budget: int | None
    evaluations: int = field(default=0)

    def left(self) -> int:
        return PER_SEARCH if self.budget is None else self.budget - self.evaluations

    def begin(self, x: Array) -> _Probe:
        value, gradient = self._evaluate(x)
        if not (np.isfinite(value) and np.isfinite(gradient).all()):
            raise NumericalError(
                "the objective is not finite at the start", next_step="Choose another start."
            )
        return _Probe(0.0, value, 0.0, x, gradient)

    def _evaluate(self, x: Array) -> tuple[float, Array]:
        self.evaluations += 1
        value, gradient = self.objective(x)
        return float(value), gradient

    def along(
        self, start: _Probe, direction: Array, slope: float, step: float
    ) -> tuple[_Probe | None, _Probe]:
        """The point that meets the Wolfe-Powell conditions, or None, and the best point seen."""
        line = _Line(self, start, direction, slope, min(PER_SEARCH, self.left()))
        low, probe = line.extrapolate(step)
        probe = line.interpolate(low, probe) if probe is not None else None
        return (probe if probe is not None and line.accepts(probe) else None), line.best


@dataclass
class _Line:
    """One line search from `start` along `direction`."""

    search: _Search
    start: _Probe
    direction: Array
    slope: float
    left: int

    def __post_init__(self) -> None:
        self.origin = _Probe(0.0, self.start.value, self.slope, self.start.x, self.start.gradient)
        self.best = self.origin

    def probe(self, step: float) -> _Probe | None:
        """The evaluation at `step`, None where the objective is not finite."""
        self.left -= 1
        x = self.start.x + step * self.direction
        value, gradient = self.search._evaluate(x)
        if not (np.isfinite(value) and np.isfinite(gradient).all()):
            return None
        probe = _Probe(step, value, float(gradient @ self.direction), x, gradient)
        if value < self.best.value:
            self.best = probe
        return probe

    def too_high(self, probe: _Probe) -> bool:
        return probe.value > self.start.value + DECREASE * probe.step * self.slope

    def accepts(self, probe: _Probe) -> bool:
        return abs(probe.slope) <= -CURVATURE * self.slope and not self.too_high(probe)

    def extrapolate(self, step: float) -> tuple[_Probe, _Probe | None]:
        """Walk outwards until the slope has flattened or the value risen: the last two points."""
        low = self.origin
        while self.left > 0:
            probe = self.probe(step)
            if probe is None:
                step = 0.5 * (low.step + step)
                continue
            if probe.slope > CURVATURE * self.slope or self.too_high(probe) or self.left <= 0:
                return low, probe
            step = _beyond(low, probe)
            low = probe
        return low, None

    def interpolate(self, low: _Probe, probe: _Probe) -> _Probe:
        """Shrink the bracket until the conditions hold or the evaluations run out."""
        high = probe
        while not self.accepts(probe) and self.left > 0:
            if probe.slope > 0.0 or self.too_high(probe):
                high = probe
            else:
                low = probe
            if high is low:
                return probe
            step = _between(low, high, quadratic=high.value > self.start.value)
            tried = self.probe(step)
            if tried is None:
                return probe
            probe = tried
        return probe


def _beyond(near: _Probe, far: _Probe) -> float:
    """Where the cubic through two points has its minimum, kept between a little and STRETCH further."""
    gap = far.step - near.step
    # the slope of the cubic (Hermite) at a distance s from `near` is slope + 2 b s / gap² + a s² / gap³
    a = 6.0 * (near.value - far.value) + 3.0 * (far.slope + near.slope) * gap
    b = 3.0 * (far.value - near.value) - (2.0 * near.slope + far.slope) * gap
    inside = b * b - a * near.slope * gap
    step = np.nan if inside < 0.0 else near.step - near.slope * gap**2 / _nonzero(b + np.sqrt(inside))
    if not np.isfinite(step) or step < 0.0:
        return far.step * STRETCH
    return float(np.clip(step, far.step + MARGIN * gap, far.step * STRETCH))


def _between(low: _Probe, high: _Probe, *, quadratic: bool) -> float:
    """Where the quadratic or cubic through the bracket has its minimum, kept off the bracket's ends."""
    gap = high.step - low.step
    if quadratic:
        step = low.step - 0.5 * low.slope * gap**2 / _nonzero(high.value - low.value - low.slope * gap)
    else:
        # the slope of the cubic (Hermite) at a distance s from `low` is slope + (2 b s + a s²) / gap²
        a = 6.0 * (low.value - high.value) / gap + 3.0 * (high.slope + low.slope)
        b = 3.0 * (high.value - low.value) - (2.0 * low.slope + high.slope) * gap
        inside = b * b - a * low.slope * gap**2
        step = np.nan if inside < 0.0 else low.step + (np.sqrt(inside) - b) / _nonzero(a)
    if not np.isfinite(step):
        return low.step + 0.5 * gap
    lower, upper = sorted((low.step + MARGIN * gap, high.step - MARGIN * gap))
    return float(np.clip(step, lower, upper))


def _nonzero(value: float) -> float:
    return value if value != 0.0 else float(np.finfo(float).tiny)
