"""One seed of the study of flights: every arm learns from the same first flight, and all sit the same tests.

An arm is a way to choose flights: one of the three random baselines, or a design criterion. Streams of random
numbers are named by the seed and what they are for, so that no arm's luck depends on another arm.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from etude.campaign import preset_config
from etude.design import DesignConfig, design
from etude.protocols import Trajectory
from etude.types import Array, Samples
from etude_quadrotor import KIND
from etude_studies.flight_orders_judge import Judge, Round
from etude_studies.flight_orders_world import World
from etude_studies.flight_world import SAMPLERS

BASELINES = ("uniform", "scaled", "boundary")
CRITERIA = ("mean_variance", "info_gain", "ivr", "log_ivr")
ARMS = (*BASELINES, *CRITERIA)
EXTREME = ("mean_variance", "info_gain")
"""Criteria whose flights, designed for other seeds, are the extreme tests."""
FIRST, TEST, REFERENCE, ARM = 0, 1, 2, 10
"""Streams of a seed's random numbers; arms count up from ARM."""
INTENDED = 20
"""Flights that a model is for."""


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
    design: DesignConfig = field(default_factory=lambda: preset_config(KIND, "default").design)


def first_round(world: World, seed: int, *, every_kind: bool) -> Round:
    """After the uniform random flight that all arms of the seed begin with."""
    rng = np.random.default_rng([seed, FIRST])
    parameters = SAMPLERS["uniform"](rng, world.flights.feasible)[0]
    return _taught(world, None, parameters, rng, every_kind=every_kind)


def rounds(
    world: World, seed: int, arm: str, first: Round, flights: int, effort: Effort, *, every_kind: bool
) -> Iterator[Round]:
    """Rounds 2 .. `flights` of an arm."""
    last = first
    for number in range(1, flights):
        rng = np.random.default_rng([seed, ARM + ARMS.index(arm), number])
        parameters = next_flight(world, seed, arm, last, effort, rng)
        last = _taught(world, last, parameters, rng, every_kind=every_kind)
        yield last


def _taught(
    world: World, last: Round | None, parameters: Array, rng: np.random.Generator, *, every_kind: bool
) -> Round:
    """After one more flight."""
    flights, campaign = world.flights, world.flights.world
    logs, flown = (last.logs, last.parameters) if last else ((), ())
    logs = (*logs, *flights.flown([flights.family.trajectory(parameters)], rng))
    previous = last.selection.model if last else None
    selection = campaign.learned(campaign.samples(*logs), world.config(every_kind=every_kind), rng, previous)
    return Round(logs, selection, (*flown, parameters))


def next_flight(
    world: World, seed: int, arm: str, last: Round, effort: Effort, rng: np.random.Generator
) -> Array:
    """(P,) of the flight that an arm chooses."""
    flights = world.flights
    if arm in BASELINES:
        return np.asarray(SAMPLERS[arm](rng, flights.feasible)[0])
    model = last.process
    return design(
        flights.family,
        flights.limits,
        flights.home,
        world.planning(model.inputs),
        model,
        replace(effort.design, criterion=arm),
        rng,
        intended_flights(world, seed),
        rate=flights.world.spec.rate,
    ).parameters


def intended_flights(world: World, seed: int) -> list[Trajectory]:
    """The named set that designs are for and deviations are judged on: uniform, and none of the tests."""
    return world.flights.drawn(np.random.default_rng([seed, REFERENCE]), INTENDED)


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
        structure; `speed[arm]`: mean speed of each flight, m/s; `cpu_s`.
    """
    began, world = time.process_time(), World.of(preset, effort.points)
    tests = flown_tests(world, seed, extremes, effort)
    first = first_round(world, seed, every_kind=True)
    judge = Judge.of(world, intended_flights(world, seed), first)
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
) -> dict[str, Samples]:
    """The three test sets of a seed, flown; the same for all its arms."""
    rng, flights = np.random.default_rng([seed, TEST]), world.flights
    designed = [flights.family.trajectory(p) for p in some_extremes(extremes, effort.tests["extremes"], rng)]
    chosen = {
        "uniform": flights.drawn(rng, effort.tests["uniform"]),
        "boundary": flights.drawn(rng, effort.tests["boundary"], "boundary"),
        "extremes": designed,
    }
    return {
        name: flights.world.samples(*flights.flown(parameters, rng)) for name, parameters in chosen.items()
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
    flight = world.flights.family.trajectory(parameters)
    velocity = flight.motion(np.linspace(0.0, flight.duration, 301)[:-1], 2).orders[1]
    return float(np.linalg.norm(velocity, axis=1).mean())
