"""Design of the next trajectory: random candidates inside the limits, the best few refined by L-BFGS."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from etude._runtime.scipy_parts import minimise
from etude.design.candidates import ClearPoseSource, ReachablePoses, SampledPoint, Source
from etude.design.config import DesignConfig
from etude.design.criteria import RESOLUTION, Batch, Output, Reduction, batch_of, criterion_named, needs_of
from etude.design.latents import Latent, latents_of, of_parameters, planned
from etude.design.nonconvex_limits import NonconvexLimits, PenalisedObjective
from etude.design.objective import MOTIONS, Objective, SearchFunction, gains_of, instants, reference_states
from etude.errors import UsageError
from etude.limits.feasible import FeasibleSet
from etude.models.gp.cholesky import factorise, triangular_inverse
from etude.models.gp.exact import ExactPosterior, posterior_given
from etude.progress import counted, part
from etude.protocols import Family, Inputs, Limit, Model, Physics, Posterior, Trajectory
from etude.threads import threads_for
from etude.types import Array


@dataclass(frozen=True, eq=False)
class Aim:
    """The objective of a design, and the model's own processes, which forecast its effect.

    Attributes:
        objective: the criterion, with its constant parts precomputed.
        latents: the model's own latent functions, prepared for planned samples.
        outputs: the same with their reference states.
    """

    objective: Objective
    latents: tuple[Latent, ...]
    outputs: tuple[Output, ...]

    def deviations(self, drawn: SampledPoint) -> tuple[Array, Array]:
        """(J,) forecast root mean square deviation of each command before and after a trajectory."""
        plan = replace(self.objective, family=drawn.family).planned(drawn.p)
        gains = gains_of([latent.commands for latent in self.latents], plan.gains)
        pairs: dict[int, tuple[float, float]] = {}
        for latent, output, gain in zip(self.latents, self.outputs, gains.T, strict=True):
            removed = Reduction.of(output, batch_of(output.posterior, plan.X), gain).values
            now = float(np.sqrt(output.reference_variance.mean()))
            then = float(np.sqrt(np.maximum(output.reference_variance - removed, 0.0).mean()))
            for command, factor in zip(latent.commands, latent.factors, strict=True):
                pairs[command] = (factor * now, factor * then)
        before, after = zip(*(pairs[command] for command in sorted(pairs)), strict=True)
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
    """The objective that `solve.design` maximises, with the same arguments; `standing_in` replaces tasks."""
    criterion = criterion_named(config.criterion)
    duration = family.trajectory(np.zeros(family.size)).duration
    share = 1.0
    if config.planned_noise:
        if not rate > 0.0:
            raise UsageError("planned_noise needs the rate of the logs", where="design.planned_noise")
        share = config.points / max(rate * duration, config.points)
    model_latents = tuple(model) if isinstance(model, Sequence) else latents_of(model)
    ahead = planned_samples(inputs, given, config.points)
    latents = with_planned(planned(model_latents, share, config.inducing), ahead)
    outputs = _outputs(latents, inputs, config, tasks, standing_in)
    scored_outputs, scored_latents = outputs, latents
    if needs_of(criterion) == "identified":
        scored_latents = with_planned(planned(of_parameters(model_latents, physics or {}), share, 0), ahead)
        references = {
            j: output.reference
            for latent, output in zip(latents, outputs, strict=True)
            for j in latent.commands
        }
        scored_outputs = tuple(
            Output.of(one.posterior, references[one.commands[0]]) for one in scored_latents
        )
    times, keep = instants(duration, config.points, inputs.rate)
    commands = tuple(latent.commands for latent in scored_latents)
    return Aim(Objective(criterion, scored_outputs, commands, inputs, family, times, keep), latents, outputs)


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
"""Weight above which a planned sample is added, with full weight, to an exact process (it has one noise)."""


def conditioned_on_planned(posterior: Posterior, X: Array, gains: Array) -> Posterior:
    """The posterior given samples at X (p, D) with gains (p,) that are planned, not yet measured.

    An exact process is refitted, which makes the design cheapest: with the samples that will not be masked.
    Their values are the process's mean, so that the mean stays. Other posteriors use `Conditioned`.
    """
    if not isinstance(posterior, ExactPosterior):
        return Conditioned.on(posterior, X, gains)
    informative = X[gains**2 >= HALF]
    if not len(informative):
        return posterior
    samples = (
        np.concatenate([posterior.X, informative]),
        np.concatenate([posterior.y, posterior.mean(informative)]),
    )
    refit = posterior_given(posterior.kernel, posterior.theta, posterior.noise_variance, *samples)
    refit.__dict__["signal_variance"] = posterior.signal_variance  # the same scale for all segments
    return refit


@dataclass(frozen=True, eq=False)
class Conditioned:
    """Any posterior, given samples at X (p, D) with gains d (p,) that are planned, not yet measured.

    With B = cov(., X) d L^-T and L Lᵀ = d C_XX d + sn^2 I its covariance is cov(., .) - B Bᵀ. A sample with
    gain 0 (a joint at rest) changes nothing. Means stay the same.

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
        if name == "X":  # the samples learned so far, which criteria of parameters need
            return getattr(self.posterior, name)
        raise AttributeError(name)

    def factors(self, X: Array) -> ConditionedBatch:
        """Factors that covariances and gradients at X (T, D) share."""
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

    conditioned: Conditioned
    base: Batch
    explained: Array

    def variance(self) -> Array:
        return np.asarray(np.maximum(self.base.variance() - (self.explained**2).sum(axis=1), 0.0))

    def covariance(self, other: ConditionedBatch | None = None) -> Array:
        second = self if other is None else other
        prior = self.base.covariance(None if other is None else other.base)
        return np.asarray(prior - self.explained @ second.explained.T)

    def gradient(
        self,
        *,
        variance: Array | None = None,
        own: Array | None = None,
        cross: tuple[ConditionedBatch, Array] | None = None,
        reduction: tuple[ConditionedBatch, Array, Array] | None = None,
    ) -> Array:
        """Gradient through the base, and through B, which depends on the covariances with X."""
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
        return through + self.base.gradient(cross=(self.conditioned.planned, weights @ self.conditioned.root))


def with_planned(latents: Sequence[Latent], samples: tuple[Array, Array] | None) -> tuple[Latent, ...]:
    """The latent functions, given planned samples."""
    if samples is None:
        return tuple(latents)
    X, gains = samples[0], gains_of([latent.commands for latent in latents], samples[1])
    return tuple(
        replace(latent, posterior=conditioned_on_planned(latent.posterior, X, gain))
        for latent, gain in zip(latents, gains.T, strict=True)
    )


VALUED, DRAWN = 0.1, 0.2
"""Approximate fractions of a search's time, for progress: to rank candidates, and to shrink the best to the
limits. The rest is refinement."""


@dataclass(frozen=True, eq=False)
class Design:
    """A designed trajectory and how it was found.

    Attributes:
        trajectory: inside the limits; the caller certifies the written bytes.
        family: its family, with the random draws (omega0) fixed. parameters: (P,) of the trajectory in it.
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
        """Relative reduction of the variance afterwards (geometric mean), compared with the median candidate.

        Only for `log_ivr`, whose value is minus a sum of mean logarithms; None for other criteria.
        """
        if self.criterion != "log_ivr":
            return None
        return 1.0 - math.exp((self.typical - self.value) / self.outputs)

    @property
    def variance_removed(self) -> float:
        """Forecast fraction of the reference variance that this motion removes, mean over commands."""
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
    roam: ReachablePoses | None = None,
) -> Design:
    """The most informative trajectory of `family` for `model`, inside the limits.

    Args:
        family: which trajectories may be proposed.
        limits: limits of the robot.
        home: (k,) a pose inside every limit.
        inputs: the model's feature map, with what was learned about plans.
        model: the learned model; before any log, latent functions as of `latents.prior_latents`.
        config: criterion and effort.
        rng: source of candidates and of random reference motions.
        tasks: motions that the model is needed for.
        standing_in: motions that replace or complement tasks; none: random members of the family.
        given: motions that will be run before this one, without logs so far.
        rate: Hz of the logs, for `config.planned_noise`.
        physics: of the kind, for criteria that need the identified model.
        roam: reachable poses, and those that were visited; None: motions about home.

    Raises:
        UnsafeTrajectoryError: the limits leave no room.
        UsageError: a task is of another robot, the criterion needs more than the model has, or it fails.
    """
    started = time.process_time()
    for task in tasks:
        axes = task.motion(np.zeros(1), 1).orders.shape[2]
        if axes != len(home):
            raise UsageError(f"a task has {axes} coordinates, the robot has {len(home)}")
    with threads_for(0):
        source: Source | ClearPoseSource = Source(family, tuple(limits), home, config.sampler)
        if roam is not None:
            source = ClearPoseSource.of(family, tuple(limits), roam, config.sampler)
        others = standing_in or [drawn.trajectory for drawn in source.typical(rng, MOTIONS)]
        aim = design_objective(
            family, inputs, model, config, tasks, others, given=given, rate=rate, physics=physics
        )
        result = search(aim.objective, source.candidates(rng, config.candidates), config, limits)
        before, after = aim.deviations(result.best)
    return Design(
        trajectory=result.best.trajectory,
        family=result.best.family,
        parameters=result.best.p,
        status=_status(config, result),
        criterion=config.criterion,
        value=result.value,
        baseline=result.baseline,
        typical=result.typical,
        deviation_before=before,
        deviation_after=after,
        evaluations=result.evaluations,
        seconds=time.process_time() - started,
        outputs=len(aim.objective.outputs),
    )


def variance_removed(before: Array, after: Array) -> float:
    """Fraction of variance removed, mean over commands, from deviations (J,) before and after."""
    is_exact = before == 0.0
    left = after / np.where(is_exact, 1.0, before)
    return float(np.mean(np.where(is_exact, 0.0, 1.0 - left**2)))


@dataclass(frozen=True, eq=False)
class SearchResult:
    """Result of a search: the best trajectory, its value, and those of the best and the median candidate."""

    best: SampledPoint
    value: float
    baseline: float
    typical: float
    evaluations: int


CORNER = 30
"""Exponent p of the smooth corner at the edge of the limits. It costs a few per cent, which the final step
recovers."""
LEAST_VALUE = 1e-12
"""Value at the start after scaling: L-BFGS takes differences far below 1 for convergence."""


class Merit(Protocol):
    """Function to be maximised: an `Objective`, or one minus a penalty."""

    def value(self, p: Array) -> float: ...
    def value_and_gradient(self, p: Array) -> tuple[float, Array]: ...


@dataclass(frozen=True, eq=False)
class Refinement:
    """Result of a refinement: parameters (P,) inside the limits, their value, number of evaluations."""

    p: Array
    value: float
    evaluations: int


def refine(objective: Merit, feasible: FeasibleSet, start: Array, steps: int) -> Refinement:
    """The best point in `steps` iterations from `start` (P,), moved to the exact edge if that is better."""
    search = Search(objective, feasible)
    first = search.variables(start)
    best = BestPoint(-np.inf, first)

    def cost(y: Array) -> tuple[float, Array]:
        value, gradient = search.value_and_gradient(y)
        best.offer(value, y)
        scale = 1.0 / max(abs(best.first), LEAST_VALUE)
        return -scale * value, -scale * gradient

    # 20 pairs of the inverse Hessian for tens of parameters; 10 evaluations a line search at most
    minimise(cost, first, steps=steps, corrections=20, searched=10)
    p, value = _to_the_edge(objective, feasible, search.inside(best.y), best.value)
    return Refinement(p, value, best.count + len(feasible.blocks))


def _to_the_edge(objective: Merit, feasible: FeasibleSet, p: Array, value: float) -> tuple[Array, float]:
    """Enlarge each block in turn to the exact edge of its limits, where this increases the value."""
    full = feasible.enlarge(p)
    for block in feasible.blocks:
        trial = p.copy()
        trial[block.members] = full[block.members]
        trial_value = objective.value(trial)
        if trial_value > value:
            p, value = trial, trial_value
    return p, value


@dataclass
class BestPoint:
    """The best point so far, because a line search may end elsewhere; first: the value at the start."""

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

    p = centre + T y, T the ellipsoid of the limits' rows, so that numbers are of order one. A block with the
    gauge g is scaled about the centre by (1 + g^p)^(-1/p), which is nearly 1 inside and 1/g outside. This
    always suffices, since g is the smooth gauge, never below the true one. So every evaluation is at a
    trajectory inside the limits, and the search has no constraints and no corners.
    """

    objective: Merit
    feasible: FeasibleSet

    @cached_property
    def shape(self) -> Array:
        """T (P, P)."""
        return self.feasible.ellipsoid()

    def variables(self, p: Array) -> Array:
        """y (P,) of parameters, without the scaling at the limits."""
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
    size = (1.0 / larger) ** CORNER + (use / larger) ** CORNER
    return np.asarray(size ** (-1.0 / CORNER) / larger)


@dataclass
class RankedCandidates:
    """Candidates ranked by value, shrunk towards home only where this can change the result.

    A shrunk motion is smaller and less informative. So the value of a candidate as sampled is about an upper
    bound of its value after shrinking.

    Attributes:
        candidates: ordered by their values as sampled, best first. values: current value of each.
        drawn: indices of those that were shrunk.
    """

    candidates: list[SampledPoint]
    values: list[float]
    drawn: list[int]

    @classmethod
    def of(cls, aim: SearchFunction, candidates: Sequence[SampledPoint]) -> RankedCandidates:
        """Ranking of candidates as sampled, none of them shrunk yet."""
        values = [aim.of(one.family).value(one.p) for one in counted(candidates)]
        order = np.argsort(values)[::-1].tolist()
        return cls([candidates[i] for i in order], [values[i] for i in order], [])

    def draw(self, aim: SearchFunction, nonconvex: NonconvexLimits, place: int) -> float:
        """Shrink a candidate to the limits and return its value."""
        if place not in self.drawn:
            one = self.candidates[place]
            home = one.home(nonconvex)
            if home is not one:
                self.candidates[place] = home
                self.values[place] = aim.of(home.family).value(home.p)
            self.drawn.append(place)
        return self.values[place]

    def best(self, aim: SearchFunction, nonconvex: NonconvexLimits, count: int) -> list[int]:
        """Indices of the `count` candidates with the highest values after shrinking."""
        ranking: list[int] = []
        for place in counted(range(len(self.values))):
            if len(ranking) >= count:
                one, least = self.candidates[place], self.values[ranking[count - 1]]
                if least >= self.values[place]:
                    break
                if not one.may_exceed(nonconvex, aim.of(one.family).value, least):
                    continue
            self.draw(aim, nonconvex, place)
            ranking = sorted([*ranking, place], key=lambda i: -self.values[i])
        return ranking[:count]

    def typical(self, aim: SearchFunction, nonconvex: NonconvexLimits) -> float:
        """Value of the median candidate after shrinking; the mean of the two middle ones if even."""
        last = len(self.values) - 1
        return float(np.mean([self.draw(aim, nonconvex, place) for place in (last // 2, (last + 1) // 2)]))


def search(
    aim: SearchFunction,
    candidates: Sequence[SampledPoint],
    config: DesignConfig,
    limits: Sequence[Limit] = (),
) -> SearchResult:
    """The best of the candidates and of the refinements of the best few.

    Nonconvex limits have three steps. Candidates that may win are shrunk towards home until they keep the
    limits. A penalty counts during refinement. Its results are shrunk and then enlarged. All of this uses
    fast checks; only the best trajectory is proved.
    """
    nonconvex = NonconvexLimits.of(limits, candidates[0].family, candidates[0].p)
    with part(VALUED):
        ranked = RankedCandidates.of(aim, candidates)
    with part(DRAWN):
        places = ranked.best(aim, nonconvex, max(config.refine, 1))
    baseline, typical = ranked.values[places[0]], ranked.typical(aim, nonconvex)
    weight = nonconvex.weight((one.family, one.p) for one in (ranked.candidates[i] for i in ranked.drawn))
    best, value, evaluations = ranked.candidates[places[0]], baseline, len(candidates)
    for place in counted(places[: config.refine], whole=1.0 - VALUED - DRAWN):
        start = ranked.candidates[place]
        objective = aim.of(start.family)
        searched = (
            PenalisedObjective(objective, nonconvex, weight * abs(ranked.values[place]))
            if weight > 0.0
            else objective
        )
        end = refine(searched, start.feasible, start.p, config.steps)
        evaluations += end.evaluations
        refined = start.allowed(nonconvex, end.p, objective.value)
        is_known = refined.p is end.p and searched is objective
        refined_value = end.value if is_known else objective.value(refined.p)
        if refined_value > value:
            best, value = refined, refined_value
    if nonconvex.limits:
        settled = nonconvex.settled(best.family, best.standing, best.p)
        if settled is not best.p:
            best = replace(best, p=settled)
            value = aim.of(best.family).value(settled)
    return SearchResult(best, value, baseline, typical, evaluations)


def _status(config: DesignConfig, result: SearchResult) -> str:
    if result.value > result.baseline:
        text = f"{config.criterion} {result.value:.4g}, refined from {result.baseline:.4g}"
    else:
        text = f"{config.criterion} {result.value:.4g}, not improved by refinement"
    return f"{text}, the best of {config.candidates} random candidates."
