"""The flights that the models of chapter 5 are tested on: those of all arms of a seed, never trained on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from etude.design import reference_states
from etude.models import TRANSIENT_S
from etude.protocols import Trajectory
from etude.types import Array, Index, Mask, Samples
from etude_studies.flight_orders_cell import some_extremes
from etude_studies.thesis.flight_rounds import (
    FRESH,
    NOISE,
    REFERENCE,
    TEST,
    Round,
    first_round,
    flown_round,
    next_flight,
    undragged,
)
from etude_studies.thesis.flight_settings import FlightSettings, Learning, Place, flights_of

SETS = ("uniform", "boundary", "extreme")
EXTREME_SEEDS = tuple(range(1_000_000, 1_000_003))
"""Their designed flights are the extreme tests; no run has one of these seeds."""
EXTREME_CRITERIA = ("mean_variance", "info_gain")
EXTREME_FLIGHTS = 3
INTENDED, REFERENCE_STATES = 20, 300
"""Flights that a model is for, and states along all of them."""
JUDGED_S, ALONE_S = 2.0, 0.1
"""Apart are the samples at which variances are judged, of a set of flights and of a single one: neighbours
say the same, and a variance costs as much as a thousand means."""


@dataclass(frozen=True, eq=False)
class FlightSet:
    """Flights of one set, as samples.

    Attributes:
        samples: each flight a group. spacing: s between samples at which variances are judged.
    """

    samples: Samples
    spacing: float

    @property
    def command(self) -> Array:
        """(n, 4)."""
        return self.samples.command

    @cached_property
    def judged(self) -> Index:
        """Positions of the samples at which variances are judged."""
        t = self.samples.t
        step = float(np.median(np.diff(t)))
        every = max(1, round(self.spacing / step))
        return np.flatnonzero(np.round(t / step).astype(np.int64) % every == every // 2)

    @cached_property
    def late(self) -> Mask:
        """(n,) after the transient of a start from rest."""
        return np.asarray(self.samples.t >= TRANSIENT_S)

    def flight_mean(self, rows: Array, use: Mask | None = None) -> Array:
        """(J,) mean over flights of the mean of each one's rows (n, J), where `use` is set."""
        group = self.samples.group
        selected = np.ones(len(group), dtype=np.bool_) if use is None else use
        means = [
            rows[flight].mean(axis=0) for i in np.unique(group) if (flight := selected & (group == i)).any()
        ]
        return np.asarray(np.mean(means, axis=0)) if means else np.full(rows.shape[1], np.nan)


@dataclass(frozen=True, eq=False)
class FlightTests:
    """Everything that the models of a seed are tested on.

    Attributes:
        sets: by name. fresh: one flight for each number of training flights. deviation: (4,) of each command
            over all sets.
    """

    sets: dict[str, FlightSet]
    fresh: tuple[FlightSet, ...]

    @cached_property
    def deviation(self) -> Array:
        """(4,) of the commands over all sets."""
        return np.asarray(
            np.concatenate([flight_set.command for flight_set in self.sets.values()]).std(axis=0)
        )


def flown_tests(settings: FlightSettings, seed: int) -> FlightTests:
    """The tests of an arm; arms of one place share them."""
    return _flown_tests(settings.place, settings.tests, settings.flights, seed)


@lru_cache(maxsize=4)
def _flown_tests(place: Place, counts: tuple[int, int, int], fresh: int, seed: int) -> FlightTests:
    flights = flights_of(place)
    chosen: dict[str, Sequence[Trajectory]] = {}
    for number, (name, count) in enumerate(zip(SETS, counts, strict=True)):
        rng = np.random.default_rng([seed, TEST, number])
        if count and name == "extreme":
            pool = extreme_flights(place)
            chosen[name] = [flights.family.trajectory(p) for p in some_extremes(pool, count, rng)]
        elif count:
            chosen[name] = flights.drawn(rng, count, name)
    sets = {
        name: FlightSet(_flown(place, parameters, [seed, TEST, SETS.index(name), NOISE]), JUDGED_S)
        for name, parameters in chosen.items()
    }
    alone = sets["uniform"].samples
    sets["single"] = FlightSet(alone.take(alone.group == 0), ALONE_S)
    others = flights.drawn(np.random.default_rng([seed, FRESH]), fresh)
    logs = (_flown(place, [parameters], [seed, FRESH, NOISE, i]) for i, parameters in enumerate(others))
    return FlightTests(sets, tuple(FlightSet(flight_logs, ALONE_S) for flight_logs in logs))


def _flown(place: Place, flights: Sequence[Trajectory], stream: list[int]) -> Samples:
    return place.samples(*flights_of(place).flown(flights, np.random.default_rng(stream)))


@lru_cache(maxsize=8)
def extreme_flights(place: Place) -> dict[str, list[Array]]:
    """Parameters of flights designed for the seeds that are used for nothing else, by criterion."""
    settings = FlightSettings(
        place.vehicle, place.preset, "designed", speed=place.speed, harmonics=place.harmonics
    )
    designs: dict[str, list[Array]] = {criterion: [] for criterion in EXTREME_CRITERIA}
    for seed in EXTREME_SEEDS:
        for number, criterion in enumerate(EXTREME_CRITERIA):
            designs[criterion] += _designed(settings, seed, criterion, number)
    return designs


def _designed(settings: FlightSettings, seed: int, criterion: str, number: int) -> list[Array]:
    learning = Learning(settings.place)
    last: Round = first_round(learning, seed)
    rng = np.random.default_rng([seed, TEST, number])
    config = replace(settings.design, criterion=criterion, candidates=24, refine=1, planned_noise=True)
    for _ in range(1, EXTREME_FLIGHTS):
        last = flown_round(learning, seed, last, next_flight(settings, last, rng, config))
    return list(last.parameters[1:])


@lru_cache(maxsize=8)
def reference(learning: Learning, seed: int) -> Array:
    """(300, D) model inputs along uniform flights that a model is for: none of the tests, flown perfectly."""
    intended = flights_of(learning.place).drawn(np.random.default_rng([seed, REFERENCE]), INTENDED)
    inputs = undragged(first_round(learning, seed).model.inputs)
    (X,) = reference_states(inputs, [(0, 1, 2, 3)], REFERENCE_STATES, intended)
    return X
