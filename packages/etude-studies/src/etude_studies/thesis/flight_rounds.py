"""Flight after flight of one arm of chapter 5: the first one common to all, then random or designed ones.

Streams of random numbers are named by the seed and what they are for, so that no arm's luck depends on
another arm: the noise of flight k is the same in all of them.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.linalg import LinAlgError, cholesky, solve_triangular

from etude.design import DesignConfig, design
from etude.models import ExactGP, ExactPosterior, LearnedModel
from etude.protocols import Inputs, Trajectory
from etude.trajectories import Chain
from etude.types import Array, Log, Samples
from etude_quadrotor import QuadrotorInputs
from etude_studies.flight_world import SAMPLERS, Flights
from etude_studies.thesis.flight_settings import FlightSettings, Learning, flights_of

FIRST, TEST, REFERENCE, NOISE, TRAIN, FRESH, ARM = 0, 1, 2, 3, 4, 5, 10
"""Streams of a seed's random numbers; arms count up from ARM, set of tests count within TEST."""
CLEAR = 0.05
"""m above the height of contact, at which a simulated flight from the ground begins and ends."""
ARMS = ("uniform", "scaled", "boundary", "designed", "designed_one_start")


@dataclass(frozen=True, eq=False)
class Round:
    """What there is after some flights.

    Attributes:
        logs, parameters: of each flight. samples: of all. model: one process for each command.
        cpu_train, cpu_design: seconds that the last flight cost.
    """

    logs: tuple[Log, ...]
    parameters: tuple[Array, ...]
    samples: Samples
    model: LearnedModel
    cpu_train: float
    cpu_design: float = 0.0

    @property
    def number(self) -> int:
        """Flights learned."""
        return len(self.logs)


def rounds(settings: FlightSettings, seed: int) -> Iterator[Round]:
    """Rounds 1 .. `settings.flights` of an arm."""
    last = first_round(settings.learning, seed)
    yield last
    for number in range(2, settings.flights + 1):
        began = time.process_time()
        rng = np.random.default_rng([seed, ARM + ARMS.index(settings.arm), number])
        parameters = next_flight(settings, last, rng)
        spent = time.process_time() - began
        last = replace(flown_round(settings.learning, seed, last, parameters), cpu_design=spent)
        yield last


@lru_cache(maxsize=2)
def random_flights(settings: FlightSettings, seed: int) -> tuple[Log, ...]:
    """The logs of an arm that no model chooses: those of `rounds`, without learning."""
    flights = flights_of(settings.place)
    logs = _flown(settings.learning, seed, _first_parameters(settings.learning, seed), 1)
    for number in range(2, settings.flights + 1):
        rng = np.random.default_rng([seed, ARM + ARMS.index(settings.arm), number])
        logs += _flown(settings.learning, seed, SAMPLERS[settings.arm](rng, flights.feasible)[0], number)
    return logs


def _first_parameters(learning: Learning, seed: int) -> Array:
    flights = flights_of(learning.place)
    parameters: Array = SAMPLERS["uniform"](np.random.default_rng([seed, FIRST]), flights.feasible)[0]
    return parameters


@lru_cache(maxsize=8)
def first_round(learning: Learning, seed: int) -> Round:
    """After the uniform random flight that all arms of a seed begin with; it sets the hyperparameters."""
    flights = flights_of(learning.place)
    parameters = _first_parameters(learning, seed)
    logs = _flown(learning, seed, parameters, 1, from_ground=learning.from_ground)
    samples = learning.place.samples(*logs)
    began = time.process_time()
    world = replace(flights.world, config=learning.config)
    selection = world.learned(samples, world.config.model, np.random.default_rng([seed, TRAIN]))
    return Round(logs, (parameters,), samples, selection.model, time.process_time() - began)


def flown_round(learning: Learning, seed: int, last: Round, parameters: Array) -> Round:
    """After one more flight, every sample of which the processes take in."""
    logs = (*last.logs, *_flown(learning, seed, parameters, last.number + 1))
    samples = learning.place.samples(*logs)
    began = time.process_time()
    model = taught(last.model, samples)
    return Round(logs, (*last.parameters, parameters), samples, model, time.process_time() - began)


def _flown(
    learning: Learning, seed: int, parameters: Array, number: int, *, from_ground: bool = False
) -> tuple[Log, ...]:
    flights = flights_of(learning.place)
    rng = np.random.default_rng([seed, NOISE, number])
    flight = flights.family.trajectory(parameters)
    return tuple(flights.flown([between_ground(flights, flight) if from_ground else flight], rng))


def between_ground(flights: Flights, flight: Trajectory) -> Trajectory:
    """The flight from take-off to landing; both from and to just above the ground, which ends a flight."""
    world, vehicle = flights.world, flights.robot.vehicle
    pose = np.array([*flights.home[:2], vehicle.parameters.contact_height + CLEAR])
    transitions = world.kind.approaches(world.spec, flight, pose)
    assert transitions is not None
    there, back = transitions
    return Chain((*there.parts, ("segment", flight), *back.parts))  # type: ignore[attr-defined]


def next_flight(
    settings: FlightSettings, last: Round, rng: np.random.Generator, config: DesignConfig | None = None
) -> Array:
    """(P,) of the flight that an arm chooses; `config` in place of its design's."""
    flights = flights_of(settings.place)
    if config is None and settings.arm in SAMPLERS:
        return np.asarray(SAMPLERS[settings.arm](rng, flights.feasible)[0])
    inputs, rate = undragged(last.model.inputs), flights.world.spec.rate
    family, limits, home = flights.family, flights.limits, flights.home
    config = config or settings.design
    return design(family, limits, home, inputs, last.model, config, rng, rate=rate).parameters


def undragged(inputs: Inputs) -> Inputs:
    """For plans as the thesis makes them: the attitude is that of a vehicle without drag."""
    assert isinstance(inputs, QuadrotorInputs)
    return replace(inputs, drag=(0.0, 0.0, 0.0))


def taught(model: LearnedModel, samples: Samples) -> LearnedModel:
    """The model on all samples, those it has first: hyperparameters and units stay (thesis 5.2).

    What a campaign's schedule "first" makes of the same samples, without what only a choice among models
    needs.
    """
    X = model.inputs.of_log(samples.log)
    candidates = []
    for candidate, posterior in zip(model.candidates, processes(model), strict=True):
        (command,), (offset, factor) = candidate.commands, candidate.units[:, 0]
        y = (samples.command[:, command] - offset) / factor
        updated = extended(posterior, X[len(posterior.X) :], y[len(posterior.X) :])
        process = replace(candidate.process, own=(updated,), teaching=None)  # type: ignore[type-var]
        candidates.append(replace(candidate, process=process))
    return replace(model, candidates=tuple(candidates))


def processes(model: LearnedModel) -> list[ExactPosterior]:
    """The exact process of each candidate, which is that of one command."""
    posteriors = []
    for candidate in model.candidates:
        assert candidate.process is not None
        ((posterior, _),) = candidate.process.latents()
        assert isinstance(posterior, ExactPosterior)
        posteriors.append(posterior)
    return posteriors


def extended(posterior: ExactPosterior, X: Array, y: Array) -> ExactPosterior:
    """The posterior with more points X (m, D), y (m,): its factor grows by a block, at the price of n^2 m."""
    kernel, theta, n, m = posterior.kernel, posterior.theta, len(posterior.X), len(X)
    everything = np.concatenate([posterior.X, X]), np.concatenate([posterior.y, y])
    across = solve_triangular(posterior.L, kernel.value(theta, posterior.X, X), lower=True)
    corner_block = kernel.value(theta, X, X) - across.T @ across
    corner_block[np.diag_indices(m)] += posterior.noise_variance + posterior.jitter
    try:
        corner = cholesky(corner_block, lower=True)
    except LinAlgError:  # rounding; a factor made at once says how much it had to add
        return ExactGP(kernel, theta, 0.5 * float(np.log(posterior.noise_variance))).condition(*everything)
    L = np.zeros((n + m, n + m), order="F")
    L[:n, :n], L[n:, :n], L[n:, n:] = posterior.L, across.T, corner
    enlarged = replace(posterior, X=everything[0], y=everything[1])
    enlarged.__dict__["factor"] = L, posterior.jitter
    return enlarged
