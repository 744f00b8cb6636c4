"""What a design maximises: a model's processes, the states that count, and what will be known by then."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude.design.batch import batch_of
from etude.design.candidates import Drawn
from etude.design.conditioned import given_planned
from etude.design.config import DesignConfig
from etude.design.criteria import Output, Reduction, criterion_named, needs_of
from etude.design.objective import Objective, gains_of, instants
from etude.design.reference import reference_states
from etude.design.view import Latent, latents_of, of_parameters, planned
from etude.errors import UsageError
from etude.protocols import Family, Inputs, Model, Physics, Trajectory
from etude.types import Array


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
    model: Model | Sequence[Latent],
    config: DesignConfig,
    tasks: Sequence[Trajectory],
    standing_in: Sequence[Trajectory],
    *,
    given: Sequence[Trajectory] = (),
    rate: float = 0.0,
    physics: Mapping[str, Physics] | None = None,
) -> Aim:
    """What `solve.design` maximises; arguments as there, and the motions that stand in for tasks."""
    criterion = criterion_named(config.criterion)
    duration = family.trajectory(np.zeros(family.size)).duration
    share = 1.0
    if config.planned_noise:
        if not rate > 0.0:
            raise UsageError("planned_noise needs the rate of the logs", where="design.planned_noise")
        share = config.points / max(rate * duration, config.points)
    own = tuple(model) if isinstance(model, Sequence) else latents_of(model)
    ahead = planned_samples(inputs, given, config.points)
    latents = with_planned(planned(own, share, config.inducing), ahead)
    outputs = _outputs(latents, inputs, config, tasks, standing_in)
    judged, asked = outputs, latents
    if needs_of(criterion) == "identified":
        asked = with_planned(planned(of_parameters(own, physics or {}), share, 0), ahead)
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


def planned_samples(inputs: Inputs, given: Sequence[Trajectory], points: int) -> tuple[Array, Array] | None:
    """Model inputs (n, D) and gains (n, J) of motions that will be run, `points` of each segment."""
    plans = []
    for trajectory in given:
        for _, label, piece in trajectory.pieces():
            if label == "segment":
                times, keep = instants(piece.duration, points, inputs.rate)
                plans.append(inputs.plan(piece.motion(times, inputs.orders), keep))
    if not plans:
        return None
    return np.concatenate([plan.X for plan in plans]), np.concatenate([plan.gains for plan in plans])


def with_planned(latents: Sequence[Latent], samples: tuple[Array, Array] | None) -> tuple[Latent, ...]:
    """The latent functions, given planned samples."""
    if samples is None:
        return tuple(latents)
    X, gains = samples[0], gains_of([latent.commands for latent in latents], samples[1])
    return tuple(
        replace(latent, posterior=given_planned(latent.posterior, X, own))
        for latent, own in zip(latents, gains.T, strict=True)
    )
