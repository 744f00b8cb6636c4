"""The part of the study of design about flights: is 30 s of flight better spent on two than on one?"""

from __future__ import annotations

import numpy as np

from etude.contracts import Array, Controller, Log
from etude.robots.quadrotor.controller import leaning
from etude_studies.flight_world import Flights

LENGTHS = (15.0, 30.0)
SECONDS = 60.0
"""s of flight in all."""
MOTION, RUN, FIT, TEST = range(4)
"""Streams of random numbers."""


def flights(name: str, seed: int) -> dict[str, float]:
    """Error in the loop, m, by seconds of flight, of random flights of 15 and of 30 s.

    The first is flown under feedback alone, later ones with what was learned of the drag, as `etude simulate`
    does; its largest distance from the plan stands beside it.
    """
    found: dict[str, float] = {}
    for length in LENGTHS:
        own = Flights.of(name, "low", duration=length)
        logs: list[Log] = []
        controller: Controller | None = None
        while len(logs) * length < SECONDS:
            number = len(logs)
            flight = own.drawn(np.random.default_rng([seed, MOTION, number]), 1)[0]
            logs += [own.robot.test(flight, controller, np.random.default_rng([seed, RUN, number]))]
            found[f"{length:g}-s farthest {number + 1}"] = _farthest(logs[-1])
            model = own.world.learned(
                own.world.samples(*logs), own.world.config.model, np.random.default_rng([seed, FIT])
            ).model
            controller = leaning(model)
            found |= _judged(
                own, own.world.kind.controller(own.world.spec, own.world.config, model), logs, seed
            )
    return found


def _farthest(log: Log) -> float:
    """Largest distance from the plan, m."""
    error: Array = np.linalg.norm(log["position_des"] - log["position"], axis=1)
    return float(error.max())


def _judged(own: Flights, controller: Controller, logs: list[Log], seed: int) -> dict[str, float]:
    """Mean distance from the plan on the kind's tests, m, by its seconds of flight."""
    world = own.world
    tests = world.kind.tests(world.spec, world.config, np.random.default_rng([seed, TEST]))
    errors = [
        own.robot.error(own.robot.test(test, controller, np.random.default_rng([seed, TEST, 1])))[0][-1]
        for test in tests.values()
    ]
    length = own.world.config.trajectory.duration
    return {f"{length:g}-s after {length * len(logs):g} s": float(np.mean(errors))}
