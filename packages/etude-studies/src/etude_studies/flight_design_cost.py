"""Cost of the design of one flight, and the saving by exact gradients over finite differences."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude.design import DesignConfig, Objective, design, design_objective, refine
from etude.limits import uniform
from etude.models import LearnedModel
from etude.protocols import Trajectory
from etude.threads import threads_for
from etude.types import Array
from etude_studies.flight_world import THESIS_ROOM, Flights
from etude_studies.rows import Row

LEARNED, INTENDED = 4, 20
"""Flights that the model has learned, and that it is for."""
STEP = 1e-6
"""Of finite differences, in parameters (m)."""


@dataclass(frozen=True, eq=False)
class Differenced(Objective):
    """The same value with its gradient by forward differences, for comparison."""

    def value_and_gradient(self, p: Array) -> tuple[float, Array]:
        """One evaluation of the value, and one for each parameter."""
        value = self.value(p)
        return value, np.array([(self.value(p + step) - value) / STEP for step in STEP * np.eye(len(p))])


def design_rows(
    rng: np.random.Generator, config: DesignConfig | None = None, *, starts: int = 4
) -> list[Row]:
    """The cost of a design, by default that of the kind's preset, of a process that has learned 4 flights.

    `design_cpu_s`: CPU of all of it. `design_gradient_speedup`: CPU of finite differences over that of exact
    gradients, whole searches from the same starts; `design_gradient_value`: the mean value each reached.
    """
    flights = Flights.of("quadrotor", "low", room=THESIS_ROOM)
    config = flights.world.config.design if config is None else config
    model, tasks = known_flights(flights, rng), flights.drawn(rng, INTENDED)
    place, rate = (flights.family, flights.limits, flights.home), flights.world.spec.rate
    result = design(*place, model.inputs, model, config, rng, tasks, rate=rate)
    exact, differences = _both_ways(flights, model, config, tasks, starts, rng)
    return [
        Row("design_cpu_s", result.seconds, "s", "required at most", 3.0),
        Row("design_value", result.value, "1", "best of the random flights", result.baseline),
        Row("design_gradient_speedup", differences[0] / exact[0], "1", "required at least", 4.0),
        Row("design_gradient_value", exact[1], "1", "finite differences", differences[1]),
    ]


def known_flights(flights: Flights, rng: np.random.Generator, count: int = LEARNED) -> LearnedModel:
    """The process of the commands after `count` uniform flights."""
    world = flights.world
    samples = world.samples(*flights.flown(flights.drawn(rng, count), rng))
    return world.learned(samples, replace(world.config.model, rung="gp"), rng).model


def _both_ways(
    flights: Flights,
    model: LearnedModel,
    config: DesignConfig,
    tasks: Sequence[Trajectory],
    starts: int,
    rng: np.random.Generator,
) -> list[tuple[float, float]]:
    """CPU in s and mean value reached by exact gradients and by finite differences, from the same starts."""
    points, options = uniform(rng, flights.feasible, starts), {"rate": flights.world.spec.rate}
    results = []
    with threads_for(0):
        exact = design_objective(
            flights.family, model.inputs, model, config, tasks, tasks, **options
        ).objective
        for objective in (exact, Differenced(**vars(exact))):
            began = time.process_time()
            ends = [refine(objective, flights.feasible, point, config.steps) for point in points]
            results.append((time.process_time() - began, float(np.mean([end.value for end in ends]))))
    return results
