"""What a design maximises: a model's processes, the states that count, and what will be known by then."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from etude.design.candidates import Drawn
from etude.design.config import DesignConfig
from etude.design.criteria import Output, Reduction, criterion_named, needs_of
from etude.design.latents import Latent, latents_of, of_parameters, planned
from etude.design.objective import Objective, gains_of, instants, reference_states
from etude.design.score import RESOLUTION, Batch, batch_of
from etude.errors import UsageError
from etude.models.gp.cholesky import factorise, triangular_inverse
from etude.models.gp.exact import ExactPosterior, posterior_given
from etude.protocols import Family, Inputs, Model, Physics, Posterior, Trajectory
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


def design_objective(
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


HALF = 0.5
"""Weight from which a planned sample counts as a whole one of an exact process, of one noise for all."""


def given_planned(posterior: Posterior, X: Array, gains: Array) -> Posterior:
    """The posterior given samples at X (p, D) with gains (p,) that nobody has measured yet.

    An exact process is refitted, as nothing is cheaper to design with: with those samples that would not be
    masked, at its own mean, so that its mean stays. Any other is seen through `Conditioned`.
    """
    if not isinstance(posterior, ExactPosterior):
        return Conditioned.on(posterior, X, gains)
    informative = X[gains**2 >= HALF]
    if not len(informative):
        return posterior
    known = (
        np.concatenate([posterior.X, informative]),
        np.concatenate([posterior.y, posterior.mean(informative)]),
    )
    refit = posterior_given(posterior.kernel, posterior.theta, posterior.noise_variance, *known)
    refit.__dict__["signal_variance"] = posterior.signal_variance  # the measure of all segments alike
    return refit


@dataclass(frozen=True, eq=False)
class Conditioned:
    """Any posterior, given samples at X (p, D) with gains d (p,) that nobody has measured yet.

    With B = cov(., X) d L^-T and L Lᵀ = d C_XX d + sn^2 I its covariance is cov(., .) - B Bᵀ. A sample of
    gain 0 (a joint that stands) changes nothing. Means stay.

    Attributes:
        posterior: without the planned samples.
        planned: of X, a batch of it.
        root: (p, p) L^-1 d.
    """

    posterior: Posterior
    planned: Batch
    root: Array

    @classmethod
    def on(cls, posterior: Posterior, X: Array, gains: Array) -> Conditioned:
        """The posterior given planned samples at X (p, D), p >= 1, with gains (p,)."""
        planned = batch_of(posterior, X)
        noise = max(posterior.noise_variance, RESOLUTION * posterior.signal_variance)
        weighed = np.asfortranarray(gains[:, None] * planned.covariance() * gains)
        L, _ = factorise(weighed, noise, announce=False)
        return cls(posterior, planned, triangular_inverse(L) * gains)

    @property
    def noise_variance(self) -> float:
        return self.posterior.noise_variance

    @property
    def signal_variance(self) -> float:
        return self.posterior.signal_variance

    def __getattr__(self, name: str) -> Any:
        if name == "X":  # the samples learned so far, which criteria of parameters ask for
            return getattr(self.posterior, name)
        raise AttributeError(name)

    def factors(self, X: Array) -> ConditionedBatch:
        """What covariances and gradients at X (T, D) share."""
        base = batch_of(self.posterior, X)
        return ConditionedBatch(self, base, base.covariance(self.planned) @ self.root.T)

    def predict(self, X: Array) -> tuple[Array, Array]:
        return self.posterior.predict(X)[0], self.factors(X).variance()

    def mean_gradient(self, X: Array) -> Array:
        return self.posterior.mean_gradient(X)

    def variance_gradient(self, X: Array, g: Array) -> Array:
        return self.factors(X).gradient(variance=g)

    def covariance(self, X: Array, Z: Array) -> Array:
        return self.factors(X).covariance(self.factors(Z))

    def covariance_gradient(self, X: Array, Z: Array, G: Array) -> Array:
        return self.factors(X).gradient(cross=(self.factors(Z), G))


@dataclass(frozen=True, eq=False)
class ConditionedBatch:
    """Implements `batch.Batch`. base: of the posterior without the planned samples; explained: B (T, p)."""

    given: Conditioned
    base: Batch
    explained: Array

    def variance(self) -> Array:
        return np.asarray(np.maximum(self.base.variance() - (self.explained**2).sum(axis=1), 0.0))

    def covariance(self, other: ConditionedBatch | None = None) -> Array:
        known = self if other is None else other
        prior = self.base.covariance(None if other is None else other.base)
        return np.asarray(prior - self.explained @ known.explained.T)

    def gradient(
        self,
        *,
        variance: Array | None = None,
        own: Array | None = None,
        cross: tuple[ConditionedBatch, Array] | None = None,
        reduction: tuple[ConditionedBatch, Array, Array] | None = None,
    ) -> Array:
        """Through the base, and through B: its weights lead back to the covariances with X."""
        B, weights = self.explained, np.zeros_like(self.explained)
        if variance is not None:
            weights -= 2.0 * variance[:, None] * B
        if own is not None:
            weights -= (own + own.T) @ B
        if cross is not None:
            weights -= cross[1] @ cross[0].explained
        if reduction is not None:
            other, left, right = reduction
            weights += 2.0 * left @ (right.T @ B - other.explained)
        through = self.base.gradient(
            variance=variance,
            own=own,
            cross=None if cross is None else (cross[0].base, cross[1]),
            reduction=None if reduction is None else (reduction[0].base, *reduction[1:]),
        )
        return through + self.base.gradient(cross=(self.given.planned, weights @ self.given.root))


def with_planned(latents: Sequence[Latent], samples: tuple[Array, Array] | None) -> tuple[Latent, ...]:
    """The latent functions, given planned samples."""
    if samples is None:
        return tuple(latents)
    X, gains = samples[0], gains_of([latent.commands for latent in latents], samples[1])
    return tuple(
        replace(latent, posterior=given_planned(latent.posterior, X, own))
        for latent, own in zip(latents, gains.T, strict=True)
    )
