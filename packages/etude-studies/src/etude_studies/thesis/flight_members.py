"""Dictionaries, sparse spectra and full GPR on the same flights of the quadrotor (7.1.1)."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl

from etude.models import LearnedModel
from etude.threads import threads_for
from etude_studies.measured import Measured
from etude_studies.thesis.arm_measures import Figure
from etude_studies.thesis.flight_measures import PARTS, by_command
from etude_studies.thesis.flight_rounds import TRAIN, random_flights
from etude_studies.thesis.flight_settings import FlightSettings, flights_of
from etude_studies.thesis.flight_tests import SETS, FlightSet, flown_tests

AFTER = (10,)
"""Flights learned."""
MEMBERS: Mapping[str, dict[str, Any]] = {
    "exact": {"process": "exact"},
    "dictionary_error": {"process": "thesis_dictionary_error", "points": 500},
    "dictionary_variance": {"process": "thesis_dictionary_variance", "points": 500},
    "ssgp_learned": {"process": "ssgp_learned", "basis": 200},
    "ssgp_fixed": {"process": "ssgp_fixed", "basis": 200},
}
"""Keys of [model]: sizes are chapter 6's, the rest is Q1's. All train on the first flight alone (5.2)."""


def run(
    settings: Mapping[str, Any],
    seed: int,
    needs: Mapping[str, pl.DataFrame],  # noqa: ARG001
) -> list[Measured]:
    """Y5: mean absolute error of each member on the tests of Q1's seed; k counts flights learned.

    Args:
        settings: `members`, names of `MEMBERS`, and `after`, flights learned; all of both if not given.
            Others are those of `FlightSettings`. seed: of the study. needs: nothing.
    """
    keys = dict(settings)
    names, after = keys.pop("members", tuple(MEMBERS)), keys.pop("after", AFTER)
    flight_settings = FlightSettings(**{"flights": max(after), **keys})
    with threads_for(0):
        return [row for k in after for name in names for row in _member(flight_settings, seed, k, name)]


def _member(settings: FlightSettings, seed: int, k: int, name: str) -> Iterator[Measured]:
    """Every test of one member after `k` flights, and the processor seconds of its training."""
    world, unit = flights_of(settings.place).world, np.ones(len(PARTS[settings.vehicle]))
    samples = settings.place.samples(*random_flights(settings, seed)[:k])
    config = replace(settings.learning.config.model, **MEMBERS[name])
    began = time.process_time()
    model = world.learned(samples, config, np.random.default_rng([seed, TRAIN])).model
    yield Measured(k, "", name, "mean", "cpu_train", time.process_time() - began)
    tests = flown_tests(settings, seed).sets
    for test in (test_name for test_name in SETS if test_name in tests):
        yield from by_command(settings.vehicle, unit, k, test, name, _errors(model, tests[test]))


def _errors(model: LearnedModel, test: FlightSet) -> Iterator[Figure]:
    yield "mae", test.flight_mean(np.abs(test.command - model.mean(test.samples.log)))
