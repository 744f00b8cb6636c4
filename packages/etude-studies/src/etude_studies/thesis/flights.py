"""The runs of chapter 5: a simulated quadrotor (5.2) and, in place of the Pelican, its simulated class (5.3).

The protocol is that of the text: hyperparameters of the first flight, then constant; a process for each
command; every sample of every flight; flights of (3.3), random or of largest mean variance (3.4). Departures:

* The first flight of 5.3 was learned from take-off to landing: P6u and P6d do so, from 5 cm above the ground;
  in the others every flight is its trajectory alone.
* `fmincon` had differences for derivatives and starts that are not told; here gradients are exact, with
  several starts or with one, and the processes are seen through 300 of their samples. Planned samples of a
  design are 75, whose mean variance agrees with that of 300 in three digits.
* Variances over a set of tests are taken every 2 s, those of a single flight at 10 Hz.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl

from etude.threads import threads_for
from etude.types import Array
from etude_studies.measured import Measured
from etude_studies.thesis.flight_measures import (
    PARTS,
    ahead_figures,
    by_command,
    coverage_figures,
    half_range,
    hyperparameters,
    line_figures,
    lines,
    means_at,
    nearest,
    own_figures,
    variances_at,
)
from etude_studies.thesis.flight_rounds import Round, first_round, rounds
from etude_studies.thesis.flight_settings import FlightSettings, flights_of
from etude_studies.thesis.flight_tests import FlightSet, FlightTests, flown_tests, reference

AHEAD_S = 0.5
"""Between samples of a flight at which variances are taken before it is learned."""
_Q = FlightSettings()
_P = FlightSettings("pelican", "pelican", flights=6, tests=(20, 6, 6))
_D = replace(_Q, arm="designed")
FLIGHT_RUNS: dict[str, tuple[str, FlightSettings]] = {
    "Q1": ("quadrotor, flights drawn uniformly from the allowed ones", _Q),
    "Q2": ("quadrotor, random flights of random size", replace(_Q, arm="scaled")),
    "Q3": ("quadrotor, random flights on the edge of the allowed ones", replace(_Q, arm="boundary")),
    "Q4": ("quadrotor, flights of largest mean variance, 8 starts", _D),
    "Q5": (
        "quadrotor, flights of largest mean variance, one start, 300 planned samples",
        replace(_Q, arm="designed_one_start", steps=60, points=300),
    ),
    "Q6u": ("Q1 with a noise floor of 0.2 deviations", replace(_Q, noise_floor=0.2)),
    "Q6d": ("Q4 with a noise floor of 0.2 deviations", replace(_D, noise_floor=0.2)),
    "Q7u": ("Q1 with flights up to 3 m/s", replace(_Q, speed=3.0)),
    "Q7d": ("Q4 with flights up to 3 m/s", replace(_D, speed=3.0)),
    "Q8u": ("Q1 with five harmonics", replace(_Q, harmonics=5)),
    "Q8d": ("Q4 with five harmonics", replace(_D, harmonics=5)),
    "P1": ("simulated Pelican, flights drawn uniformly from the allowed ones", _P),
    "P2": ("simulated Pelican, flights of largest mean variance, 8 starts", replace(_P, arm="designed")),
    "P3": ("simulated Pelican, random flights of random size", replace(_P, arm="scaled")),
    "P4": (
        "simulated Pelican, flights of largest mean variance, one start",
        replace(_P, arm="designed_one_start", steps=60),
    ),
    "P6u": ("P1 with a first flight from take-off to landing", replace(_P, from_ground=True)),
    "P6d": (
        "P2 with a first flight from take-off to landing",
        replace(_P, arm="designed", from_ground=True),
    ),
    "P5u": ("P1 with kinematic acceleration", replace(_P, acceleration="kinematic")),
    "P5d": ("P2 with kinematic acceleration", replace(_P, arm="designed", acceleration="kinematic")),
}
"""By id: one sentence, and settings."""
_SMALL: dict[str, Any] = {"flights": 2, "tests": (2, 1, 0)}
SMALL_FLIGHTS: dict[str, tuple[str, FlightSettings]] = {
    "mQ1": ("Q1 in miniature", replace(_Q, **_SMALL)),
    "mP2": ("P2 in miniature", replace(_P, arm="designed", steps=5, **_SMALL)),
}
"""A run of each vehicle that takes seconds."""


def run_flights(
    settings: FlightSettings | Mapping[str, Any],
    seed: int,
    needs: Mapping[str, pl.DataFrame],  # noqa: ARG001
) -> list[Measured]:
    """All figures of one arm of one seed, after each of its flights.

    Args:
        settings: of the arm, or the same as JSON gives it back. seed: names all streams of random numbers.
        needs: nothing; every arm flies its seed's tests, or takes them from an arm of this process.
    """
    flight_settings = settings if isinstance(settings, FlightSettings) else FlightSettings(**settings)
    with threads_for(0):
        tests, rows = flown_tests(flight_settings, seed), list[Measured]()
        unit = tests.deviation if flight_settings.vehicle == "pelican" else np.ones(4)
        last: Round | None = None
        for now in rounds(flight_settings, seed):
            if last is None:
                rows += _learned(flight_settings.vehicle, now)
            else:
                rows += _ahead(flight_settings.vehicle, unit, last, now)
            rows += _of_flights(flight_settings, seed, now)
            rows += _tested(flight_settings, unit, tests, now)
            last = now
    return rows


def _learned(vehicle: str, first: Round) -> Iterator[Measured]:
    """Hyperparameters, which stay those of the first flight."""
    for command, name, value in hyperparameters(first.model):
        yield Measured(1, "", "", PARTS[vehicle][command], name, value)


def _ahead(vehicle: str, unit: Array, last: Round, now: Round) -> Iterator[Measured]:
    """Of a flight before it is learned."""
    new = FlightSet(now.samples.take(now.samples.group == last.number), AHEAD_S)
    yield from by_command(vehicle, unit, now.number, "", "", ahead_figures(last.model, new))
    X, training = (
        last.model.inputs.of_log(round_samples.log) for round_samples in (new.samples, last.samples)
    )
    scale = half_range(training[last.samples.group == 0])
    yield Measured(now.number, "", "", "mean", "nearest", float(np.median(nearest(X, training, scale))))


def _of_flights(settings: FlightSettings, seed: int, now: Round) -> Iterator[Measured]:
    """Of the flights themselves, and what they cost."""
    k, inputs = now.number, now.model.inputs
    first = first_round(settings.learning, seed)
    scale = half_range(inputs.of_log(first.samples.log))
    X, states = inputs.of_log(now.samples.log), reference(settings.learning, seed)
    for name, value in coverage_figures(X, states, scale):
        yield Measured(k, "", "", "mean", name, value)
    yield Measured(k, "", "", "mean", "speed", mean_speed(settings, now.parameters[-1]))
    yield Measured(k, "", "", "mean", "cpu_train", now.cpu_train)
    if k > 1:
        yield Measured(k, "", "", "mean", "cpu_design", now.cpu_design)


def _tested(settings: FlightSettings, unit: Array, tests: FlightTests, now: Round) -> Iterator[Measured]:
    """The processes and the lines beside them on every set of tests."""
    k, vehicle, beside = now.number, settings.vehicle, lines(settings, now)
    sets, spent = {**tests.sets, "fresh": tests.fresh[k - 1]}, 0.0
    for name, test in sets.items():
        began = time.process_time()
        figures = list(own_figures(now.model, test))
        spent += time.process_time() - began
        yield from by_command(vehicle, unit, k, name, "", iter(figures))
        for line, mean in beside.items():
            yield from by_command(vehicle, unit, k, name, line, line_figures(mean, test))
    yield Measured(k, "", "", "mean", "cpu_predict", spent)


def mean_speed(settings: FlightSettings, parameters: Array) -> float:
    """m/s, of the plan."""
    flight = flights_of(settings.place).family.trajectory(parameters)
    velocity = flight.motion(np.linspace(0.0, flight.duration, 301)[:-1], 2).orders[1]
    return float(np.linalg.norm(velocity, axis=1).mean())


def flight_traces(
    settings: FlightSettings | None = None, seed: int = 0, flights: int = 5, part: str = "thrust"
) -> dict[str, Array]:
    """What figures 5.3 and 5.8 show, of one seed; by default of the Pelican's designed flights.

    Args:
        settings: of the arm. flights: learned, before the test. part: command.

    Returns:
        t_path (T,) s, desired, flown (T, 3) m: the second flight, the first that an arm chooses, every other
        sample. t (n,) s, actual, mean, deviation, deviation_noisy (n,): the command on the single
        test flight.
    """
    flight_settings = replace(settings or FLIGHT_RUNS["P2"][1], flights=flights)
    with threads_for(0):
        *_, last = rounds(flight_settings, seed)
        path = last.logs[1].take(np.arange(len(last.logs[1])) % 2 == 0)
        test, place = (
            flown_tests(settings or FLIGHT_RUNS["P2"][1], seed).sets["single"],
            PARTS[flight_settings.vehicle].index(part),
        )
        X = last.model.inputs.of_log(test.samples.log)
        latent, noisy = variances_at(last.model, X)
        mean = means_at(last.model, X)
    every = slice(None, None, max(1, len(X) // 300))
    return {
        "t_path": path.t,
        "desired": path["position_des"],
        "flown": path["position"],
        "t": test.samples.t[every],
        "actual": test.command[every, place],
        "mean": mean[every, place],
        "deviation": np.sqrt(latent[every, place]),
        "deviation_noisy": np.sqrt(noisy[every, place]),
    }
