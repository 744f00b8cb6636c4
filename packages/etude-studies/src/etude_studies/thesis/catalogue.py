"""Every run of the thesis by name: what it is, how many seeds it is planned with, and its spec."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

from etude.errors import UsageError, did_you_mean
from etude_studies.spec import Spec
from etude_studies.thesis.arm_runs import ARM_RUNS, CONTROLLERS, MINIATURE, arm_spec, baseline_spec
from etude_studies.thesis.beyond_runs import BEYOND_LINES, BEYOND_RUNS, ROUGH
from etude_studies.thesis.varied_runs import DESCENT, ON_PLANTS, ROUNDED, SECOND_BLOCK

ARM_SEEDS, FLIGHT_SEEDS, BEYOND_SEEDS = 20, 60, 20
SMALL_SEEDS = 2


@dataclass(frozen=True)
class Run:
    """One row of the catalogue.

    Attributes:
        name: as claims and tables call it. what: a sentence.
        seeds: planned. spec: of a seed. first: seed of its block.
    """

    name: str
    what: str
    seeds: int
    spec: Callable[[int], Spec]
    first: int = 0

    def specs(self, places: Sequence[int]) -> list[Spec]:
        """One for each place in its block."""
        return [self.spec(self.first + place) for place in places]


@cache
def catalogue() -> Mapping[str, Run]:
    """All runs by name."""
    from etude_studies.thesis.flights import FLIGHT_RUNS, SMALL_FLIGHTS
    from etude_studies.thesis.small_runs import SMALL_RUNS

    runs = []
    for name, (what, controller) in CONTROLLERS.items():
        runs.append(Run(name, what, ARM_SEEDS, partial(baseline_spec, controller)))
    for name, (what, settings) in ARM_RUNS.items():
        runs.append(Run(name, what, ARM_SEEDS, partial(arm_spec, settings)))
    for name, (what, settings) in BEYOND_RUNS.items():
        runs.append(Run(name, what, BEYOND_SEEDS, partial(arm_spec, settings)))
    for name, (what, settings) in {**DESCENT, **ROUNDED}.items():
        runs.append(Run(name, what, ARM_SEEDS, partial(arm_spec, settings)))
    for name, (what, settings) in ON_PLANTS.items():
        runs.append(Run(name, what, ARM_SEEDS, partial(arm_spec, settings), SECOND_BLOCK))
    for name, (what, controller) in BEYOND_LINES.items():
        runs.append(Run(name, what, BEYOND_SEEDS, partial(baseline_spec, controller, robot=ROUGH)))
    for name, (what, settings) in MINIATURE.items():
        runs.append(Run(name, what, SMALL_SEEDS, partial(arm_spec, settings)))
    for name, (what, flight) in FLIGHT_RUNS.items():
        runs.append(Run(name, what, FLIGHT_SEEDS, partial(flight_spec, flight.recorded)))
    for name, (what, flight) in SMALL_FLIGHTS.items():
        runs.append(Run(name, what, SMALL_SEEDS, partial(flight_spec, flight.recorded)))
    runs += [Run(name, *description) for name, description in SMALL_RUNS.items()]
    return {run.name: run for run in runs}


def flight_spec(settings: Mapping[str, Any], seed: int) -> Spec:
    """A run of chapter 5."""
    return Spec("etude_studies.thesis.flights:run_flights", settings, seed)


def run_named(name: str) -> Run:
    """The run of that name. UsageError with the nearest if there is none."""
    runs = catalogue()
    if name not in runs:
        step = f"{did_you_mean(name, runs)}Known: {', '.join(runs)}."
        raise UsageError(f"there is no run {name!r}", next_step=step)
    return runs[name]
