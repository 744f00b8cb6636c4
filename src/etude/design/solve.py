"""Design of the next trajectory: random candidates inside the limits, the best few refined."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude.contracts import Array, Family, Inputs, Limit, Model, Physics, Trajectory
from etude.design.batch import batch_of
from etude.design.candidates import Drawn, Source
from etude.design.config import DesignConfig
from etude.design.criteria import Output, Reduction, criterion_named, needs_of
from etude.design.kept import Kept, Penalised
from etude.design.objective import Objective, gains_of, instants
from etude.design.reference import MOTIONS, reference_states
from etude.design.refine import refine
from etude.design.view import Latent, latents_of, of_parameters, planned
from etude.errors import UsageError
from etude.threads import threads_for


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
        deviation_before, deviation_after: (J,) root mean square predicted deviation of each command over its
            reference states, in its unit, now and forecast for after this motion (hyperparameters unchanged).
        evaluations: evaluations of the criterion.
        seconds: CPU time.
    """

    trajectory: Trajectory
    family: Family
    parameters: Array
    status: str
    criterion: str
    value: float
    baseline: float
    deviation_before: Array
    deviation_after: Array
    evaluations: int
    seconds: float

    @property
    def variance_removed(self) -> float:
        """Fraction of the reference variance that this motion is forecast to remove, mean over commands."""
        known = self.deviation_before == 0.0
        left = self.deviation_after / np.where(known, 1.0, self.deviation_before)
        return float(np.mean(np.where(known, 0.0, 1.0 - left**2)))


def design(
    family: Family,
    limits: Sequence[Limit],
    home: Array,
    inputs: Inputs,
    model: Model,
    config: DesignConfig,
    rng: np.random.Generator,
    tasks: Sequence[Trajectory] = (),
    *,
    rate: float = 0.0,
    physics: Mapping[str, Physics] | None = None,
) -> Design:
    """The trajectory of `family` that teaches `model` most, inside the limits.

    Args:
        family: which trajectories may be proposed.
        limits: what they may not exceed.
        home: (k,) a pose inside every limit.
        inputs: the model's feature map, with what was learned about plans.
        model: what is known.
        config: criterion and effort.
        rng: source of candidates and of random reference motions.
        tasks: motions the model is for; without them random members of the family stand in.
        rate: Hz of the logs, for `config.planned_noise`.
        physics: of the kind, for criteria that need the identified model.

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
        source = Source(family, tuple(limits), home, config.sampler)
        standing_in = [drawn.trajectory for drawn in source.typical(rng, MOTIONS)]
        aim = objective(family, inputs, model, config, tasks, standing_in, rate=rate, physics=physics)
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
        deviation_before=before,
        deviation_after=after,
        evaluations=found.evaluations,
        seconds=time.process_time() - started,
    )


@dataclass(frozen=True, eq=False)
class Aim:
    """The objective of a design, and the model's own processes by which it is forecast.

    Attributes:
        objective: of the criterion, with everything that is fixed computed once.
        latents: the model's own, as planned samples see them.
        outputs: the same with their reference states.
    """

    objective: Objective
    latents: tuple[Latent, ...]
    outputs: tuple[Output, ...]

    def deviations(self, drawn: Drawn) -> tuple[Array, Array]:
        """(J,) forecast root mean square deviation of each command before and after a trajectory."""
        plan = replace(self.objective, family=drawn.family).planned(drawn.p)
        gains = gains_of([latent.commands for latent in self.latents], plan.gains)
        found: dict[int, tuple[float, float]] = {}
        for latent, output, gain in zip(self.latents, self.outputs, gains.T, strict=True):
            removed = Reduction.of(output, batch_of(output.posterior, plan.X), gain).values
            now = float(np.sqrt(output.reference_variance.mean()))
            then = float(np.sqrt(np.maximum(output.reference_variance - removed, 0.0).mean()))
            for command, factor in zip(latent.commands, latent.factors, strict=True):
                found[command] = (factor * now, factor * then)
        before, after = zip(*(found[command] for command in sorted(found)), strict=True)
        return np.array(before), np.array(after)


def objective(
    family: Family,
    inputs: Inputs,
    model: Model,
    config: DesignConfig,
    tasks: Sequence[Trajectory],
    standing_in: Sequence[Trajectory],
    *,
    rate: float = 0.0,
    physics: Mapping[str, Physics] | None = None,
) -> Aim:
    """What `design` maximises; arguments as there, and the random motions that stand in for tasks."""
    criterion = criterion_named(config.criterion)
    duration = standing_in[0].duration
    share = 1.0
    if config.planned_noise:
        if not rate > 0.0:
            raise UsageError("planned_noise needs the rate of the logs", where="design.planned_noise")
        share = config.points / max(rate * duration, config.points)
    own = latents_of(model)
    latents = planned(own, share, config.inducing)
    outputs = _outputs(latents, inputs, config, tasks, standing_in)
    judged, asked = outputs, latents
    if needs_of(criterion) == "identified":
        asked = planned(of_parameters(own, physics or {}), share, 0)
        references = {
            j: output.reference
            for latent, output in zip(latents, outputs, strict=True)
            for j in latent.commands
        }
        judged = tuple(Output.of(one.posterior, references[one.commands[0]]) for one in asked)
    times, keep = instants(duration, config.points, inputs.rate)
    commands = tuple(latent.commands for latent in asked)
    return Aim(Objective(criterion, judged, commands, inputs, family, times, keep), latents, outputs)


def _outputs(
    latents: Sequence[Latent],
    inputs: Inputs,
    config: DesignConfig,
    tasks: Sequence[Trajectory],
    standing_in: Sequence[Trajectory],
) -> tuple[Output, ...]:
    """The model's processes with the reference states at which their variance counts."""
    commands = [latent.commands for latent in latents]
    from_random = round(config.random_share * config.reference_points) if tasks else config.reference_points
    from_tasks = config.reference_points - from_random
    parts = []
    if from_tasks:
        parts.append(reference_states(inputs, commands, from_tasks, tasks, standing_in))
    if from_random:
        parts.append(reference_states(inputs, commands, from_random, standing_in))
    references = [np.concatenate(of_latent) for of_latent in zip(*parts, strict=True)]
    return tuple(
        Output.of(latent.posterior, reference, latent.raw_scale if config.raw_units else None)
        for latent, reference in zip(latents, references, strict=True)
    )


@dataclass(frozen=True, eq=False)
class Found:
    """The end of a search: the best trajectory, its value, the best candidate's, evaluations."""

    best: Drawn
    value: float
    baseline: float
    evaluations: int


def search(
    aim: Objective, candidates: Sequence[Drawn], config: DesignConfig, limits: Sequence[Limit] = ()
) -> Found:
    """The best of the candidates and of what the best few are refined to.

    What limits that are not convex forbid is drawn home, candidates and ends alike, and the ends are grown;
    between, a penalty counts.
    """
    kept = Kept.of(limits, candidates[0].family, candidates[0].p)
    weight = kept.weight((drawn.family, drawn.p) for drawn in candidates)
    starts = [_at_home(kept, drawn) for drawn in candidates]
    aims = [replace(aim, family=drawn.family) for drawn in starts]
    values = [one.value(drawn.p) for one, drawn in zip(aims, starts, strict=True)]
    order = np.argsort(values)[::-1]
    best, value, evaluations = starts[order[0]], values[order[0]], len(values)
    for place in order[: config.refine]:
        start, own = starts[place], aims[place]
        searched = Penalised(own, kept, weight * abs(values[place])) if kept.limits else own
        end = refine(searched, start.feasible, start.p, config.steps)
        evaluations += end.evaluations
        found = _at_home(kept, replace(start, p=end.p), own.value)
        found_value = own.value(found.p) if kept.limits else end.value
        if found_value > value:
            best, value = found, found_value
    return Found(best, value, values[order[0]], evaluations)


def _at_home(kept: Kept, drawn: Drawn, worth: Callable[[Array], float] | None = None) -> Drawn:
    """Drawn home until its limits are proved, and grown where that is worth something."""
    home = drawn.feasible.centre
    p = kept.drawn_home(drawn.family, home, drawn.p)
    return replace(drawn, p=p if worth is None else kept.grown(drawn.family, home, p, worth))


def _status(config: DesignConfig, found: Found) -> str:
    if found.value > found.baseline:
        text = f"{config.criterion} {found.value:.4g}, refined from {found.baseline:.4g}"
    else:
        text = f"{config.criterion} {found.value:.4g}, not improved by refinement"
    return f"{text}, the best of {config.candidates} random candidates."
