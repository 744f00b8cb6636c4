"""The parts of the study of design about flights: is 30 s better spent on two flights than on one, and is the
room enough that is kept for what tracking takes?
"""

from __future__ import annotations

import json
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from etude.campaign import Campaign, create_campaign, simulate
from etude.logs import read_log_file
from etude.protocols import Controller
from etude.types import Array, Log
from etude_quadrotor import leaning
from etude_studies.flight_world import Flights

LENGTHS = (15.0, 30.0)
SECONDS = 60.0
"""s of flight in all."""
FLIGHTS = 4
"""Of a campaign."""
MOTION, RUN, FIT, TEST = range(4)
"""Streams of random numbers."""


def flights(name: str, seed: int) -> dict[str, float]:
    """Error in the loop, m, by seconds of flight, of random flights of 15 and of 30 s.

    The first is flown under feedback alone, later ones with what was learned of the drag, as `etude simulate`
    does; its largest distance from the plan stands beside it.
    """
    errors: dict[str, float] = {}
    for length in LENGTHS:
        vehicle = Flights.of(name, "low", duration=length)
        logs: list[Log] = []
        controller: Controller | None = None
        while len(logs) * length < SECONDS:
            number = len(logs)
            flight = vehicle.drawn(np.random.default_rng([seed, MOTION, number]), 1)[0]
            logs += [vehicle.robot.test(flight, controller, np.random.default_rng([seed, RUN, number]))]
            errors[f"{length:g}-s farthest {number + 1}"] = _farthest(logs[-1])
            model = vehicle.world.learned(
                vehicle.world.samples(*logs), vehicle.world.config.model, np.random.default_rng([seed, FIT])
            ).model
            controller = leaning(model)
            errors |= _test_errors(
                vehicle,
                vehicle.world.kind.controller(vehicle.world.spec, vehicle.world.config, model),
                logs,
                seed,
            )
    return errors


def _farthest(log: Log) -> float:
    """Largest distance from the plan, m."""
    error: Array = np.linalg.norm(log["position_des"] - log["position"], axis=1)
    return float(error.max())


def _test_errors(vehicle: Flights, controller: Controller, logs: list[Log], seed: int) -> dict[str, float]:
    """Mean distance from the plan on the kind's tests, m, by its seconds of flight."""
    world, robot = vehicle.world, vehicle.robot
    tests = world.kind.tests(world.spec, world.config, np.random.default_rng([seed, TEST]))
    errors = [
        robot.error(robot.test(test, controller, np.random.default_rng([seed, TEST, 1])))[0][-1]
        for test in tests.values()
    ]
    length = vehicle.world.config.trajectory.duration
    return {f"{length:g}-s after {length * len(logs):g} s": float(np.mean(errors))}


def room(name: str, seed: int) -> dict[str, float]:
    """How many of a campaign's flights left their room, and how far each left its plan, in parts of what the
    certificate kept for it.
    """
    with TemporaryDirectory() as folder:
        campaign, _ = create_campaign(Path(folder) / "campaign", name, seed=seed)
        for _ in simulate(campaign, FLIGHTS):
            pass
        rounds = campaign.state().rounds.values()
        counts = {"left": float(sum(r.abandoned for r in rounds)), "flights": float(len(rounds))}
        completed = [r.number for r in rounds if not r.abandoned]
        return counts | {
            f"of margin {place}": _of_margin(campaign, n) for place, n in enumerate(completed, start=1)
        }


def _of_margin(campaign: Campaign, number: int) -> float:
    """Largest distance from the plan along x, y or z in parts of what is kept there between plan and wall."""
    log = read_log_file(campaign.path / "runs" / f"{number:04d}.parquet")
    proposal = campaign.path / "proposals" / f"{number:04d}" / "certificate.json"
    rows = [row for row in json.loads(proposal.read_bytes())["rows"] if row["quantity"] == "position"]
    reserve = np.asarray(campaign.spec.upper) - [row["upper"] for row in rows]
    away: Array = np.abs(log["position_des"] - log["position"]).max(axis=0)
    return float((away / reserve).max())
