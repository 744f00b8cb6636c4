"""One seed of the study of flights: every arm learns from the same first flight, and all sit the same tests.

An arm is a way to choose flights: one of the three random baselines, or a design criterion. Streams of random
numbers are named by the seed and what they are for, so that no arm's luck depends on another arm.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from etude.design.flight.config import FlightDesignConfig
from etude.design.flight.reference import IntendedFlights, flight_reference, uniform_intended
from etude.design.flight.solve import design_flight
from etude.models.flight.dataset import FlightDataset
from etude.models.flight.ladder import FlightLadder, train_flight_ladder
from etude.models.flight.model import FlightModel
from etude.models.flight.preprocess import joined
from etude.models.flight.score import score_flights
from etude.models.gp.exact import ExactGP
from etude_studies.flight_orders_world import World
from etude.trajectories.flight.samplers import SAMPLERS

Array = NDArray[np.float64]

BASELINES = ("uniform", "scaled", "boundary")
CRITERIA = ("mean_variance", "info_gain", "ivr", "log_ivr")
ARMS = (*BASELINES, *CRITERIA)
EXTREME = ("mean_variance", "info_gain")
"""Criteria whose flights, designed for other seeds, are the extreme tests."""
FIRST, TEST, REFERENCE, ARM = 0, 1, 2, 10
"""Streams of a seed's random numbers; arms count up from ARM."""
FIGURES = ("mae", "mae_after", "z2", "coverage", "nlpd", "nlpd_t", "deviation")
REFERENCE_STATES = 300


@dataclass(frozen=True)
class Effort:
    """How much is flown and computed, the same for all arms.

    Attributes:
        arms: to be compared.
        flights: of each arm, the common first one included. longer: of arms that the preset wants longer.
        tests: number of test flights by test set.
        points: cap on the samples of a process.
        design: options of the designs; the criterion is the arm's.
    """

    arms: tuple[str, ...] = ARMS
    flights: int = 5
    longer: int = 10
    tests: Mapping[str, int] = field(default_factory=lambda: {"uniform": 20, "boundary": 12, "extremes": 10})
    points: int = 1200
    design: FlightDesignConfig = field(default_factory=FlightDesignConfig)


@dataclass(frozen=True)
class Round:
    """What there is after some flights.

    Attributes:
        data: of all flights. ladder: what learned from them. parameters: (P,) of each flight.
    """

    data: FlightDataset
    ladder: FlightLadder
    parameters: tuple[Array, ...]

    @property
    def process(self) -> FlightModel:
        """The process on the commands: it chooses the flights, whichever model is in use."""
        return self.ladder.models["gp"]


def first_round(world: World, seed: int, *, every_kind: bool) -> Round:
    """After the uniform random flight that all arms of the seed begin with."""
    rng = np.random.default_rng([seed, FIRST])
    parameters = SAMPLERS["uniform"](rng, world.feasible)[0]
    data = world.fly(parameters, rng, 0)
    ladder = train_flight_ladder(data, world.plant.vehicle, world.config(every_kind=every_kind), rng)
    return Round(data, ladder, (parameters,))


def rounds(
    world: World, seed: int, arm: str, first: Round, flights: int, effort: Effort, *, every_kind: bool
) -> Iterator[Round]:
    """Rounds 2 .. `flights` of an arm."""
    last, config = first, world.config(every_kind=every_kind)
    for number in range(1, flights):
        rng = np.random.default_rng([seed, ARM + ARMS.index(arm), number])
        parameters = next_flight(world, seed, arm, last, effort, rng)
        data = joined([last.data, world.fly(parameters, rng, number)])
        ladder = train_flight_ladder(data, world.plant.vehicle, config, rng, previous=last.ladder.models)
        last = Round(data, ladder, (*last.parameters, parameters))
        yield last


def next_flight(
    world: World, seed: int, arm: str, last: Round, effort: Effort, rng: np.random.Generator
) -> Array:
    """(P,) of the flight that an arm chooses."""
    if arm in BASELINES:
        return np.asarray(SAMPLERS[arm](rng, world.feasible)[0])
    config = replace(effort.design, criterion=arm)
    drag, intended = world.planned_drag(last.data), intended_flights(world, seed)
    found = design_flight(last.process, world.plant.spec, world.family, config, rng, intended, drag)
    return world.family.parameters(found.trajectory.coefficients)


def intended_flights(world: World, seed: int) -> IntendedFlights:
    """The named set that designs are for and deviations are judged on: uniform, and none of the tests."""
    return uniform_intended(np.random.default_rng([seed, REFERENCE]), world.feasible, world.family)


def cell_measures(
    preset: str, seed: int, extremes: Mapping[str, Sequence[Array]], effort: Effort
) -> dict[str, Any]:
    """All figures of one seed.

    Args:
        preset: one of `PRESETS`. seed: of the cell.
        extremes: flights designed for other seeds, (P,) each, by criterion.
        effort: see `Effort`.

    Returns:
        `measured[arm][flights]`: `tests[set][kind][figure]`, `reference` deviations in V, and the `chosen`
        rung; `speed[arm]`: mean speed of each flight, m/s; `cpu_s`.
    """
    began, world = time.process_time(), World.of(preset, effort.points)
    tests = flown_tests(world, seed, extremes, effort)
    first = first_round(world, seed, every_kind=True)
    judge = Judge.of(world, seed, first)
    measured: dict[str, Any] = {}
    speed: dict[str, list[float]] = {}
    start = judge.measures(first, tests)
    for arm in effort.arms if world.preset.arms is None else world.preset.arms:
        flights = max(effort.flights, effort.longer if arm in world.preset.longer else 0)
        measured[arm], last = {"1": start}, first
        for last in rounds(world, seed, arm, first, flights, effort, every_kind=True):
            measured[arm][str(len(last.parameters))] = judge.measures(last, tests)
        speed[arm] = [mean_speed(world, parameters) for parameters in last.parameters]
    return {"measured": measured, "speed": speed, "cpu_s": time.process_time() - began}


def flown_tests(
    world: World, seed: int, extremes: Mapping[str, Sequence[Array]], effort: Effort
) -> dict[str, FlightDataset]:
    """The three test sets of a seed, flown; the same for all its arms."""
    rng = np.random.default_rng([seed, TEST])
    chosen: dict[str, Iterable[Array]] = {
        "uniform": SAMPLERS["uniform"](rng, world.feasible, effort.tests["uniform"]),
        "boundary": SAMPLERS["boundary"](rng, world.feasible, effort.tests["boundary"]),
        "extremes": some_extremes(extremes, effort.tests["extremes"], rng),
    }
    return {
        name: joined([world.fly(own, rng, number) for number, own in enumerate(parameters)])
        for name, parameters in chosen.items()
    }


def some_extremes(
    extremes: Mapping[str, Sequence[Array]], count: int, rng: np.random.Generator
) -> list[Array]:
    """`count` of the designed flights, as many of each criterion."""
    chosen: list[Array] = []
    for left, flights in zip(range(len(extremes), 0, -1), extremes.values(), strict=True):
        share = min(round((count - len(chosen)) / left), len(flights))
        chosen += [np.asarray(flights[i]) for i in rng.choice(len(flights), share, replace=False)]
    return chosen


def mean_speed(world: World, parameters: Array) -> float:
    """m/s, of the plan."""
    flight = world.flight(parameters)
    velocity = flight.sample(np.linspace(0.0, flight.duration, 301)[:-1]).qd
    return float(np.linalg.norm(velocity, axis=1).mean())


@dataclass(frozen=True)
class Judge:
    """What the models of one seed are measured by.

    Attributes:
        reference: (r, D) model inputs along the intended flights.
        process: with the hyperparameters of the first flight, in standardised outputs.
        deviation: of what it learned, mean over the commands, V.
    """

    reference: Array
    process: ExactGP
    deviation: float

    @classmethod
    def of(cls, world: World, seed: int, first: Round) -> Judge:
        rng, model = np.random.default_rng([seed, REFERENCE, 1]), first.process
        flights = intended_flights(world, seed)
        X = flight_reference(rng, model.features, flights, REFERENCE_STATES, world.true_drag)
        own = model.processes[0].outputs[0]
        process = ExactGP(own.kernel, own.theta, 0.5 * float(np.log(own.noise_variance)))
        return cls(X, process, float(model.deviation.mean()))

    def measures(self, last: Round, tests: Mapping[str, FlightDataset]) -> dict[str, Any]:
        """Figures of every kind on every test set, and deviations over the reference states."""
        models: dict[str, FlightModel] = {str(kind): model for kind, model in last.ladder.models.items()}
        models["ladder"] = last.ladder.model
        scores = {
            name: {kind: _figures(model, test) for kind, model in models.items()}
            for name, test in tests.items()
        }
        reference = {"latent": self.latent(last), "latent_common": self.latent_common(last)}
        return {"tests": scores, "reference": reference, "chosen": last.ladder.chosen}

    def latent(self, last: Round) -> float:
        """Mean predicted deviation of the process in use, without noise, V."""
        model = last.process
        latent = [np.sqrt(process.predict(self.reference)[1]).mean() for process in model.processes]
        return float(np.mean(model.deviation * np.mean(latent)))

    def latent_common(self, last: Round) -> float:
        """The same with the first flight's hyperparameters: what the flights alone made of it, V."""
        X = last.process.processes[0].outputs[0].X
        posterior = self.process.condition(X, np.zeros(len(X)))
        return float(self.deviation * np.sqrt(posterior.predict(self.reference)[1]).mean())


def _figures(model: FlightModel, test: FlightDataset) -> dict[str, float | None]:
    scores = score_flights(model, test)
    means = {name: getattr(scores, name) for name in FIGURES}
    return {name: float(np.nanmean(v)) if np.isfinite(v).any() else None for name, v in means.items()}
