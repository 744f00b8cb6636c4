"""Design of the next trajectory: random candidates inside the limits, the best few refined."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude.design.aim import objective
from etude.design.candidates import Drawn, Source
from etude.design.config import DesignConfig
from etude.design.kept import Kept, Penalised
from etude.design.objective import Objective
from etude.design.reference import MOTIONS
from etude.design.refine import refine
from etude.design.roaming import Roam, Roamed
from etude.design.view import Latent
from etude.errors import UsageError
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
        aim = objective(family, inputs, model, config, tasks, others, given=given, rate=rate, physics=physics)
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
class Found:
    """The end of a search: the best trajectory, its value, that of the best and of the median candidate."""

    best: Drawn
    value: float
    baseline: float
    typical: float
    evaluations: int


def search(
    aim: Objective, candidates: Sequence[Drawn], config: DesignConfig, limits: Sequence[Limit] = ()
) -> Found:
    """The best of the candidates and of what the best few are refined to.

    The candidates are at home already, as `Source` draws them. What limits that are not convex forbid of the
    ends is drawn home too, and the ends are grown; between, a penalty counts. All that is by quick words:
    only the best is proved.
    """
    kept = Kept.of(limits, candidates[0].family, candidates[0].p)
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
    return Found(best, value, values[order[0]], float(np.median(values)), evaluations)


def _status(config: DesignConfig, found: Found) -> str:
    if found.value > found.baseline:
        text = f"{config.criterion} {found.value:.4g}, refined from {found.baseline:.4g}"
    else:
        text = f"{config.criterion} {found.value:.4g}, not improved by refinement"
    return f"{text}, the best of {config.candidates} random candidates."
