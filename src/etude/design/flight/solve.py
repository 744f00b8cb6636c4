"""Design of the next flight: random feasible candidates, several searches, the winner certified."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from etude.design.batch import batch_of
from etude.design.criteria import CRITERIA, Output, Reduction
from etude.design.flight.config import FlightDesignConfig
from etude.design.flight.objective import FlightDesignModel, FlightObjective
from etude.design.flight.posterior import planned_posteriors
from etude.design.flight.reference import IntendedFlights, flight_reference, uniform_intended
from etude.design.flight.refine import Refined, refine_flight
from etude.robots.flight_spec import FlightSpec
from etude.threads import threads_for
from etude.trajectories.certificate import Certificate
from etude.trajectories.flight.certificate import require_flight_certified
from etude.trajectories.flight.family import FlightFamily
from etude.trajectories.flight.feasible import feasible_flights
from etude.trajectories.flight.feasible_set import FeasibleSet
from etude.trajectories.flight.flatness import Drag, flat_motion
from etude.trajectories.flight.motion import motion_of
from etude.trajectories.flight.samplers import boundary_parameters, uniform_parameters
from etude.trajectories.fourier import FourierTrajectory

Array = NDArray[np.float64]

CHECK_STEP = 0.05
"""s between the samples at which the attitude of the result is checked."""
CANDIDATE_STEPS = 60
"""Of the walk to each uniform candidate; they need to differ, not to be exactly uniform."""
SCOUT = 4
"""Part of the steps, 1/SCOUT, that every start gets."""
FINALISTS = 2
"""Starts that get the rest: most of a whole search polishes an end that has already lost."""


@dataclass(frozen=True)
class FlightDesign:
    """A designed flight and how it was found.

    Attributes:
        trajectory: certified inside the limits, margin included.
        certificate: its proof.
        criterion: name of the criterion.
        reference: name of the intended flights.
        value: of the criterion, to be maximised.
        baseline: value of the best random candidate.
        found: (starts,) value at the end of each search.
        deviation_before, deviation_after: predicted root mean square deviation over the reference states,
            mean over the model's processes, now and forecast for after the flight; in their output units.
        evaluations: of the criterion.
        seconds: CPU time.
    """

    trajectory: FourierTrajectory
    certificate: Certificate
    criterion: str
    reference: str
    value: float
    baseline: float
    found: Array
    deviation_before: float
    deviation_after: float
    evaluations: int
    seconds: float


def design_flight(
    model: FlightDesignModel,
    spec: FlightSpec,
    family: FlightFamily,
    config: FlightDesignConfig,
    rng: np.random.Generator,
    intended: IntendedFlights | None = None,
    drag: Drag = (0.0, 0.0, 0.0),
) -> FlightDesign:
    """The flight of `family` that teaches `model` most, certified inside the limits of `spec`.

    Args:
        model: its processes and feature map.
        spec: the vehicle and its room.
        family: which flights may be proposed.
        config: criterion and effort.
        rng: source of candidates and of default intended flights.
        intended: flights the model is for; without them uniform feasible ones stand in.
        drag: (dx, dy, dz) 1/s, known or learned, for the planned attitude. Without it the planned specific
            force is thrust alone, which the flown vehicle's is not.

    Raises:
        UnsafeTrajectoryError: the limits leave no room, or the result could not be certified.
    """
    started = time.process_time()
    feasible = feasible_flights(spec, family)
    with threads_for(0):
        chosen = uniform_intended(rng, feasible, family) if intended is None else intended
        objective = flight_objective(model, spec, family, config, rng, chosen, drag)
        candidates, values = _candidates(objective, feasible, config, rng)
        ends = _searches(objective, feasible, config, candidates[_order(values, config.starts)])
        best = max(
            [Refined(candidates[values.argmax()], float(values.max()), 0), *ends], key=lambda end: end.value
        )
        before, after = _deviations(objective, best.parameters)
    trajectory = family.trajectory(best.parameters)
    certificate = require_flight_certified(trajectory, spec, rest=family.rest)
    flat_motion(motion_of(trajectory, np.arange(0.0, family.duration, CHECK_STEP)), drag)
    return FlightDesign(
        trajectory=trajectory,
        certificate=certificate,
        criterion=config.criterion,
        reference=chosen.name,
        value=best.value,
        baseline=float(values.max()),
        found=np.array([end.value for end in ends]),
        deviation_before=before,
        deviation_after=after,
        evaluations=len(values) + sum(end.evaluations for end in ends),
        seconds=time.process_time() - started,
    )


def flight_objective(
    model: FlightDesignModel,
    spec: FlightSpec,
    family: FlightFamily,
    config: FlightDesignConfig,
    rng: np.random.Generator,
    intended: IntendedFlights,
    drag: Drag = (0.0, 0.0, 0.0),
) -> FlightObjective:
    """The criterion as `design_flight` sees it, with everything that is fixed computed once."""
    logged = max(spec.rate * family.duration, config.points)
    reference = flight_reference(rng, model.features, intended, config.reference_points, drag)
    posteriors = planned_posteriors(model.posteriors, config.points / logged, config.inducing)
    outputs = tuple(Output.of(posterior, reference) for posterior in posteriors)
    times = family.duration * (np.arange(config.points) + 0.5) / config.points
    return FlightObjective(CRITERIA[config.criterion], outputs, model.features, family, times, drag)


def _candidates(
    objective: FlightObjective, feasible: FeasibleSet, config: FlightDesignConfig, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Parameters (K, P) of random feasible flights and their values (K,)."""
    half = (config.candidates + 1) // 2
    points = uniform_parameters(rng, feasible, half, CANDIDATE_STEPS)
    if config.candidates > half:
        points = np.concatenate([points, boundary_parameters(rng, feasible, config.candidates - half)])
    return points, np.array([objective.value(point) for point in points])


def _order(values: Array, starts: int) -> NDArray[np.int64]:
    """Indices of the starts: the best half of them, then others spread over the rest, for variety."""
    order = np.argsort(values)[::-1]
    best = (starts + 1) // 2
    others = np.linspace(best, len(values) - 1, starts - best).round().astype(int)
    return np.asarray(order[[*range(best), *others]], dtype=np.int64)


def _searches(
    objective: FlightObjective, feasible: FeasibleSet, config: FlightDesignConfig, starts: Array
) -> list[Refined]:
    """Where each start led: all go a quarter of the way, the best two to the end."""
    options: dict[str, Any] = {"criterion": config.criterion, "method": config.method}
    scout = -(-config.steps // SCOUT)
    ends = [refine_flight(objective, feasible, start, steps=scout, **options) for start in starts]
    ahead = sorted(range(len(ends)), key=lambda i: ends[i].value, reverse=True)[:FINALISTS]
    for i in ahead if config.steps > scout else []:
        last = refine_flight(objective, feasible, ends[i].parameters, steps=config.steps - scout, **options)
        value, evaluations = max(last.value, ends[i].value), last.evaluations + ends[i].evaluations
        kept = last if last.value >= ends[i].value else ends[i]
        ends[i] = Refined(kept.parameters, value, evaluations)
    return ends


def _deviations(objective: FlightObjective, parameters: Array) -> tuple[float, float]:
    """Predicted root mean square deviation over the reference states before and after the flight."""
    X, before, after = objective.inputs(parameters), [], []
    for output in objective.outputs:
        removed = Reduction.of(output, batch_of(output.posterior, X), np.ones(len(X))).values
        before.append(np.sqrt(output.reference_variance.mean()))
        after.append(np.sqrt(np.maximum(output.reference_variance - removed, 0.0).mean()))
    return float(np.mean(before)), float(np.mean(after))
