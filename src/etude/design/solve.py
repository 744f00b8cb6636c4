"""Design of the next trajectory: random candidates inside the limits, the best few refined by L-BFGS."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from etude._runtime.scipy_parts import minimise
from etude.design.aim import design_objective
from etude.design.candidates import Drawn, Roam, Roamed, Source
from etude.design.config import DesignConfig
from etude.design.latents import Latent
from etude.design.nonconvex_limits import NonconvexLimits, Penalised
from etude.design.objective import MOTIONS, Objective
from etude.errors import UsageError
from etude.limits.feasible import FeasibleSet
from etude.progress import counted, part
from etude.protocols import Family, Inputs, Limit, Model, Physics, Trajectory
from etude.threads import threads_for
from etude.types import Array

DRAWN = 0.2
"""About the part of a search that candidates take; the rest refines the best of them."""


@dataclass(frozen=True, eq=False)
class Design:
    """A designed trajectory and how it was found.

    Attributes:
        trajectory: inside the limits; the certificate of the written bytes is the caller's.
        family: its own, with what was drawn (omega0). parameters: (P,) of it.
        status: one sentence.
        criterion: name of the criterion.
        value: its value, to be maximised.
        baseline: value of the best random candidate.
        typical: its value for the median candidate.
        deviation_before, deviation_after: (J,) root mean square predicted deviation of each command over its
            reference states, in its unit, now and forecast for after this motion (hyperparameters unchanged).
        evaluations: evaluations of the criterion.
        seconds: CPU time.
        outputs: latent functions that the criterion sums over.
    """

    trajectory: Trajectory
    family: Family
    parameters: Array
    status: str
    criterion: str
    value: float
    baseline: float
    typical: float
    deviation_before: Array
    deviation_after: Array
    evaluations: int
    seconds: float
    outputs: int

    @property
    def choice(self) -> float | None:
        """By which part the variance afterwards, a geometric mean, is less than with the median candidate.

        None for a criterion that does not say: of `log_ivr` the value is minus a sum of mean logarithms.
        """
        if self.criterion != "log_ivr":
            return None
        return 1.0 - math.exp((self.typical - self.value) / self.outputs)

    @property
    def variance_removed(self) -> float:
        """Fraction of the reference variance that this motion is forecast to remove, mean over commands."""
        return variance_removed(self.deviation_before, self.deviation_after)


def design(
    family: Family,
    limits: Sequence[Limit],
    home: Array,
    inputs: Inputs,
    model: Model | Sequence[Latent],
    config: DesignConfig,
    rng: np.random.Generator,
    tasks: Sequence[Trajectory] = (),
    *,
    standing_in: Sequence[Trajectory] = (),
    given: Sequence[Trajectory] = (),
    rate: float = 0.0,
    physics: Mapping[str, Physics] | None = None,
    roam: Roam | None = None,
) -> Design:
    """The trajectory of `family` that teaches `model` most, inside the limits.

    Args:
        family: which trajectories may be proposed.
        limits: what they may not exceed.
        home: (k,) a pose inside every limit.
        inputs: the model's feature map, with what was learned about plans.
        model: what is known; or latent functions, as `prior.prior_latents` has them before any log.
        config: criterion and effort.
        rng: source of candidates and of random reference motions.
        tasks: motions the model is for.
        standing_in: motions that stand in for tasks, and beside them; none: random members of the family.
        given: motions that will be run before this one; their logs are not there yet.
        rate: Hz of the logs, for `config.planned_noise`.
        physics: of the kind, for criteria that need the identified model.
        roam: where the robot can be, and what was visited; None: motions about home.

    Raises:
        UnsafeTrajectoryError: the limits leave no room.
        UsageError: a task of another robot, the model lacks what the criterion needs, or the criterion fails.
    """
    started = time.process_time()
    for task in tasks:
        axes = task.motion(np.zeros(1), 1).orders.shape[2]
        if axes != len(home):
            raise UsageError(f"a task has {axes} coordinates, the robot has {len(home)}")
    with threads_for(0):
        source: Source | Roamed = Source(family, tuple(limits), home, config.sampler)
        if roam is not None:
            source = Roamed.of(family, tuple(limits), roam, config.sampler)
        others = standing_in or [drawn.trajectory for drawn in source.typical(rng, MOTIONS)]
        aim = design_objective(
            family, inputs, model, config, tasks, others, given=given, rate=rate, physics=physics
        )
        found = search(aim.objective, source.candidates(rng, config.candidates), config, limits)
        before, after = aim.deviations(found.best)
    return Design(
        trajectory=found.best.trajectory,
        family=found.best.family,
        parameters=found.best.p,
        status=_status(config, found),
        criterion=config.criterion,
        value=found.value,
        baseline=found.baseline,
        typical=found.typical,
        deviation_before=before,
        deviation_after=after,
        evaluations=found.evaluations,
        seconds=time.process_time() - started,
        outputs=len(aim.objective.outputs),
    )


def variance_removed(before: Array, after: Array) -> float:
    """Mean over commands of the fraction of variance that is gone, of deviations (J,)."""
    known = before == 0.0
    left = after / np.where(known, 1.0, before)
    return float(np.mean(np.where(known, 0.0, 1.0 - left**2)))


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The end of a search: the best trajectory, its value, that of the best and of the median candidate."""

    best: Drawn
    value: float
    baseline: float
    typical: float
    evaluations: int


CORNER = 30
"""p of the smooth corner at the edge of the limits; the final step takes back the few per cent it costs."""
LEAST_VALUE = 1e-12
"""Values are divided by that of the start, since L-BFGS takes differences far below 1 for converged."""


class Merit(Protocol):
    """What is maximised: an `Objective`, or one less a penalty."""

    def value(self, p: Array) -> float: ...
    def value_and_gradient(self, p: Array) -> tuple[float, Array]: ...


@dataclass(frozen=True, eq=False)
class Refined:
    """Where a refinement ended: parameters (P,) inside the limits, their value, evaluations."""

    p: Array
    value: float
    evaluations: int


def refine(objective: Merit, feasible: FeasibleSet, start: Array, steps: int) -> Refined:
    """The best point met in `steps` iterations from `start` (P,), on the exact edge where that is better."""
    search = Search(objective, feasible)
    first = search.variables(start)
    best = Best(-np.inf, first)

    def cost(y: Array) -> tuple[float, Array]:
        value, gradient = search.value_and_gradient(y)
        best.offer(value, y)
        scale = 1.0 / max(abs(best.first), LEAST_VALUE)
        return -scale * value, -scale * gradient

    minimise(cost, first, steps=steps, kept=20, searched=10)
    p, value = _to_the_edge(objective, feasible, search.inside(best.y), best.value)
    return Refined(p, value, best.count + len(feasible.blocks))


def _to_the_edge(objective: Merit, feasible: FeasibleSet, p: Array, value: float) -> tuple[Array, float]:
    """Each block in turn enlarged to the exact edge of its limits, where that raises the value."""
    full = feasible.enlarge(p)
    for block in feasible.blocks:
        trial = p.copy()
        trial[block.members] = full[block.members]
        trial_value = objective.value(trial)
        if trial_value > value:
            p, value = trial, trial_value
    return p, value


@dataclass
class Best:
    """The best point seen, because a line search may end elsewhere; first: the value where it began."""

    value: float
    y: Array
    count: int = 0
    first: float = 0.0

    def offer(self, value: float, y: Array) -> None:
        if not self.count:
            self.first = value
        self.count += 1
        if value > self.value:
            self.value, self.y = value, y.copy()


@dataclass(frozen=True, eq=False)
class Search:
    """The objective on variables that cannot leave the limits.

    p = centre + T y, T the ellipsoid of the limits' rows, so that numbers are of order one. A block that uses
    its limits by g is drawn towards the centre by (1 + g^p)^(-1/p), which is nearly 1 inside and 1/g outside,
    and always enough: g is the smooth gauge, never below the true one. So every evaluation is of a trajectory
    inside, and the search has no constraints and no corners.
    """

    objective: Merit
    feasible: FeasibleSet

    @cached_property
    def shape(self) -> Array:
        """T (P, P)."""
        return self.feasible.ellipsoid()

    def variables(self, p: Array) -> Array:
        """y (P,) of parameters, before any drawing."""
        return np.asarray(np.linalg.solve(self.shape, p - self.feasible.centre))

    def inside(self, y: Array) -> Array:
        """Parameters (P,) inside the limits."""
        offset = self.shape @ y
        use, _ = self.feasible.smooth_gauge(self.feasible.centre + offset)
        return np.asarray(self.feasible.centre + offset * _shrink(use)[self.feasible.block_of])

    def value_and_gradient(self, y: Array) -> tuple[float, Array]:
        """Value at the parameters of y, and its gradient in y."""
        block_of, offset = self.feasible.block_of, self.shape @ y
        use, use_gradient = self.feasible.smooth_gauge(self.feasible.centre + offset)
        shrink = _shrink(use)
        value, gradient = self.objective.value_and_gradient(self.feasible.centre + offset * shrink[block_of])
        along = np.bincount(block_of, offset * gradient, len(use))
        in_use = -along * shrink**2 * (use * shrink) ** (CORNER - 1)
        in_offset = gradient * shrink[block_of] + use_gradient * in_use[block_of]
        return value, np.asarray(self.shape.T @ in_offset)


def _shrink(use: Array) -> Array:
    """(1 + use^p)^(-1/p) without overflow."""
    larger = np.maximum(use, 1.0)
    rest = (1.0 / larger) ** CORNER + (use / larger) ** CORNER
    return np.asarray(rest ** (-1.0 / CORNER) / larger)


def search(
    aim: Objective, candidates: Sequence[Drawn], config: DesignConfig, limits: Sequence[Limit] = ()
) -> SearchResult:
    """The best of the candidates and of what the best few are refined to.

    The candidates are at home already, as `Source` draws them. What limits that are not convex forbid of the
    ends is drawn home too, and the ends are grown; between, a penalty counts. All that is by quick words:
    only the best is proved.
    """
    kept = NonconvexLimits.of(limits, candidates[0].family, candidates[0].p)
    weight = kept.weight((drawn.family, drawn.p) for drawn in candidates)
    aims = [replace(aim, family=drawn.family) for drawn in candidates]
    with part(DRAWN):
        values = [one.value(drawn.p) for one, drawn in zip(aims, counted(candidates), strict=True)]
    order = np.argsort(values)[::-1]
    best, value, evaluations = candidates[order[0]], values[order[0]], len(values)
    for place in counted(order[: config.refine], whole=1.0 - DRAWN):
        start, own = candidates[place], aims[place]
        searched = Penalised(own, kept, weight * abs(values[place])) if weight > 0.0 else own
        end = refine(searched, start.feasible, start.p, config.steps)
        evaluations += end.evaluations
        found = start.allowed(kept, end.p, own.value)
        known = found.p is end.p and searched is own
        found_value = end.value if known else own.value(found.p)
        if found_value > value:
            best, value = found, found_value
    if kept.limits:
        settled = kept.settled(best.family, best.standing, best.p)
        if settled is not best.p:
            best = replace(best, p=settled)
            value = replace(aim, family=best.family).value(settled)
    return SearchResult(best, value, values[order[0]], float(np.median(values)), evaluations)


def _status(config: DesignConfig, found: SearchResult) -> str:
    if found.value > found.baseline:
        text = f"{config.criterion} {found.value:.4g}, refined from {found.baseline:.4g}"
    else:
        text = f"{config.criterion} {found.value:.4g}, not improved by refinement"
    return f"{text}, the best of {config.candidates} random candidates."
