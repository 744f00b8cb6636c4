"""Design of the next trajectory: certified random candidates, the best few refined, the winner certified."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.design.batch import batch_of
from etude.design.config import DesignConfig
from etude.design.criteria import CRITERIA, NEEDS_IDENTIFIED, Output, Reduction
from etude.design.identified import identified_posteriors
from etude.design.objective import DesignModel, Objective
from etude.design.reference import random_motions, reference_states
from etude.design.refine import refine
from etude.errors import UsageError
from etude.robots.spec import RobotSpec
from etude.threads import threads_for
from etude.trajectories.certificate import Certificate, require_certified
from etude.trajectories.family import TrajectoryFamily
from etude.trajectories.fourier import FourierTrajectory
from etude.trajectories.gauge import certified_rows
from etude.trajectories.random import random_trajectory
from etude.trajectories.samples import Trajectory

Array = NDArray[np.float64]

AMPLITUDE_SHARE = 4
"""Every fourth candidate has a random amplitude: slow motion is sometimes what is missing."""


@dataclass(frozen=True)
class Design:
    """A designed trajectory and how it was found.

    Attributes:
        trajectory: certified inside the limits.
        certificate: its proof.
        status: one sentence.
        criterion: name of the criterion.
        value: its value, to be maximised.
        baseline: value of the best random candidate.
        active_limits: (joint, quantity) of the limits used to within 1 %.
        deviation_before, deviation_after: (dof,) root mean square predicted deviation over the reference
            states, in output units, now and forecast for after this motion (hyperparameters unchanged).
        evaluations: evaluations of the criterion.
        seconds: CPU time.
    """

    trajectory: FourierTrajectory
    certificate: Certificate
    status: str
    criterion: str
    value: float
    baseline: float
    active_limits: tuple[tuple[str, str], ...]
    deviation_before: Array
    deviation_after: Array
    evaluations: int
    seconds: float

    @property
    def variance_removed(self) -> float:
        """Fraction of the reference variance that this motion is forecast to remove, mean over outputs."""
        return float(np.mean(1.0 - (self.deviation_after / self.deviation_before) ** 2))


def design(
    model: DesignModel,
    spec: RobotSpec,
    family: TrajectoryFamily,
    config: DesignConfig,
    rng: np.random.Generator,
    tasks: Sequence[Trajectory] | None = None,
) -> Design:
    """The trajectory of `family` that teaches `model` most, certified inside the limits of `spec`.

    Args:
        model: its posteriors, feature map and stick velocities.
        spec: the robot.
        family: which trajectories may be proposed.
        config: criterion and effort.
        rng: source of candidates and random reference motions.
        tasks: motions the model is for; without them limit-scaled random members of the family stand in.

    Raises:
        UnsafeTrajectoryError: the limits leave no room, or the result could not be certified.
        UsageError: the model has another number of joints than the robot.
    """
    started = time.process_time()
    if model.features.dof != spec.dof or len(model.posteriors) != spec.dof:
        raise UsageError(f"the model has {model.features.dof} joints, the robot '{spec.name}' has {spec.dof}")
    rows = certified_rows(spec, family)
    with threads_for(0):
        outputs = _outputs(model, spec, family, config, rng, tasks or ())
        objective = _objective(model, spec, family, config, outputs)
        candidates = _candidates(rng, spec, family, config.candidates)
        values = [objective.value(c.coefficients, c.omega0) for c in candidates]
        order = np.argsort(values)[::-1]
        best, value = candidates[order[0]], values[order[0]]
        evaluations = len(values)
        for start in (candidates[i] for i in order[: config.refine]):
            refined, refined_value, count = refine(objective, rows, spec, family, start, config.steps)
            evaluations += count
            if refined_value > value:
                best, value = refined, refined_value
        before, after = _deviations(outputs, *objective.inputs(best.coefficients, best.omega0))
    certificate = require_certified(best, spec)
    return Design(
        trajectory=best,
        certificate=certificate,
        status=_status(config, value, values[order[0]], certificate),
        criterion=config.criterion,
        value=value,
        baseline=values[order[0]],
        active_limits=certificate.active(),
        deviation_before=before,
        deviation_after=after,
        evaluations=evaluations,
        seconds=time.process_time() - started,
    )


def _outputs(
    model: DesignModel,
    spec: RobotSpec,
    family: TrajectoryFamily,
    config: DesignConfig,
    rng: np.random.Generator,
    tasks: Sequence[Trajectory],
) -> tuple[Output, ...]:
    """The model's processes with the reference states at which their variance counts."""
    stick = np.asarray(model.stick_velocity, dtype=float)
    standing_in = random_motions(rng, spec, family)
    from_random = round(config.random_share * config.reference_points) if tasks else config.reference_points
    from_tasks = config.reference_points - from_random
    parts = []
    if from_tasks:
        parts.append(reference_states(model.features, stick, from_tasks, tasks, standing_in))
    if from_random:
        parts.append(reference_states(model.features, stick, from_random, standing_in))
    references = [np.concatenate(of_output) for of_output in zip(*parts, strict=True)]
    return tuple(
        Output.of(posterior, reference, raw_units=config.raw_units)
        for posterior, reference in zip(model.posteriors, references, strict=True)
    )


def _objective(
    model: DesignModel,
    spec: RobotSpec,
    family: TrajectoryFamily,
    config: DesignConfig,
    outputs: tuple[Output, ...],
) -> Objective:
    if config.criterion in NEEDS_IDENTIFIED:
        posteriors = identified_posteriors(model, spec)
        outputs = tuple(
            Output.of(posterior, output.reference)
            for posterior, output in zip(posteriors, outputs, strict=True)
        )
    stick = np.asarray(model.stick_velocity, dtype=float)
    times = family.duration * (np.arange(config.points) + 0.5) / config.points
    return Objective(CRITERIA[config.criterion], outputs, model.features, stick, family, times)


def _candidates(
    rng: np.random.Generator, spec: RobotSpec, family: TrajectoryFamily, count: int
) -> list[FourierTrajectory]:
    return [
        random_trajectory(rng, spec, family, "amplitude" if i % AMPLITUDE_SHARE == 3 else "limits")
        for i in range(count)
    ]


def _deviations(outputs: Sequence[Output], X: Array, gains: Array) -> tuple[Array, Array]:
    """Predicted root mean square deviation over each output's reference states, before and after samples X
    (T, D) with gains (T, dof).
    """
    before, after = [], []
    for j, output in enumerate(outputs):
        removed = Reduction.of(output, batch_of(output.posterior, X), gains[:, j]).values
        before.append(np.sqrt(output.reference_variance.mean()))
        after.append(np.sqrt(np.maximum(output.reference_variance - removed, 0.0).mean()))
    return np.array(before), np.array(after)


def _status(config: DesignConfig, value: float, baseline: float, certificate: Certificate) -> str:
    names = [f"{quantity} of {axis}" for axis, quantity in certificate.active()]
    limits = f"at the limit: {', '.join(names)}" if names else "no limit is touched"
    if value > baseline:
        found = f"{config.criterion} {value:.4g}, refined from {baseline:.4g}"
    else:
        found = f"{config.criterion} {value:.4g}, not improved by refinement"
    return f"{found}, the best of {config.candidates} random candidates; {limits}."
