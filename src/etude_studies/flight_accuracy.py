"""How well each inverse model of a simulated vehicle predicts random flights, by number of flights learned.

A seed is its own training flights and its own test flights, all uniform on the feasible set. Compared are the
nominal model, the identified one (with trims, and without: drag, ground effect, back-EMF, gains), a process
alone, a process on the residual of the identified one, and the rung that the ladder chooses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError
from etude.logs.flight.log import FlightLog
from etude.models.flight.config import PRESETS, FlightModelConfig
from etude.models.flight.dataset import FlightDataset, flight_dataset
from etude.models.flight.ladder import train_flight_ladder
from etude.models.flight.model import FlightModel
from etude.models.flight.score import FlightScores, score_flights
from etude.models.flight.training import train_flight_model
from etude.plants.flight.plan import FlightPlan
from etude.plants.flight.record import flight_log
from etude.plants.flight.registry import flight_plant
from etude.plants.flight.simulated import SimulatedVehicle, Start
from etude_studies.rows import Row, mean_rows
from etude.trajectories.flight.family import FlightFamily
from etude.trajectories.flight.feasible import feasible_flights
from etude.trajectories.flight.samplers import SAMPLERS

Array = NDArray[np.float64]

FLIGHTS = (1, 2, 4)
TESTS = 12
NO_TRIMS = "identified_no_trims"


@dataclass(frozen=True)
class Setting:
    """How flights are flown and logged, and what learns from them.

    Attributes:
        noise: level of the vehicle's noise. start: of each flight. averaged: logs are means, not samples.
        config: of the models; its kind is replaced by "auto".
    """

    noise: str
    start: Start
    averaged: bool
    config: FlightModelConfig


_CLEAN = PRESETS["default"]
SETTINGS = {
    "default": Setting("low", "moving", True, _CLEAN),
    "thesis": Setting("mid", "hover", False, PRESETS["thesis"]),
    "thesis_refit": Setting(
        "mid", "hover", False, replace(_CLEAN, acceleration="kinematic", body_velocity=False)
    ),
}
"""By name: averaged logs with little noise; the thesis's own; its logs and inputs, trained as by default."""


def flight_accuracy(
    plant: str,
    preset: str,
    flights: tuple[int, ...] = FLIGHTS,
    seeds: tuple[int, ...] = tuple(range(4)),
    *,
    tests: int = TESTS,
) -> list[Row]:
    """`mae_<kind>_<n>` after n flights, beside nominal; `mae_after_`, `z2_`, `coverage_`, `nlpd_t_` likewise.

    Args:
        plant: a simulated vehicle. preset: one of `SETTINGS`.
        flights: numbers of training flights. seeds: each with `tests` test flights of its own.

    Raises:
        UsageError: unknown plant or preset.
    """
    if preset not in SETTINGS:
        raise UsageError(f"there is no setting {preset!r}", next_step=f"Known: {', '.join(SETTINGS)}.")
    found: dict[tuple[int, str], list[FlightScores]] = {}
    for seed in seeds:
        rng = np.random.default_rng(seed)
        vehicle, setting = replace(flight_plant(plant), noise=SETTINGS[preset].noise), SETTINGS[preset]
        logs = random_logs(vehicle, setting, max(flights) + tests, rng)
        test = flight_dataset(logs[-tests:], vehicle.spec)
        for count in flights:
            train = flight_dataset(logs[:count], vehicle.spec)
            for kind, model in _models(train, vehicle, setting.config, rng).items():
                found.setdefault((count, kind), []).append(score_flights(model, test))
    return [row for (count, kind), scores in found.items() for row in _rows(count, kind, scores, found)]


def random_logs(
    vehicle: SimulatedVehicle, setting: Setting, count: int, rng: np.random.Generator
) -> list[FlightLog]:
    """Logs of `count` flights, uniform on the feasible set of the vehicle's room and speed."""
    # tilt and thrust do not bind in this room, and the thesis's set has none
    spec = replace(vehicle.spec, tilt=None, thrust=None)
    family = FlightFamily(start=setting.start)
    parameters = SAMPLERS["uniform"](rng, feasible_flights(spec, family), count)
    t = np.arange(round(family.duration * vehicle.rate)) / vehicle.rate
    logs = []
    for own in parameters:
        motion = family.trajectory(own).sample(t)
        plan = FlightPlan(t, motion.q, motion.qd)
        flight = vehicle.fly(plan, rng, setting.start)
        logs.append(flight_log(flight, plan, vehicle.spec.rate, setting.averaged))
    return logs


def _models(
    train: FlightDataset, vehicle: SimulatedVehicle, config: FlightModelConfig, rng: np.random.Generator
) -> dict[str, FlightModel]:
    ladder = train_flight_ladder(train, vehicle.vehicle, replace(config, kind="auto"), rng)
    bare = replace(config, kind="identified", trims=False, steps=0)  # its process predicts nothing
    models: dict[str, FlightModel] = {str(kind): model for kind, model in ladder.models.items()}
    models["ladder"] = ladder.model
    if train.command_unit == "V":
        models[NO_TRIMS] = train_flight_model(train, vehicle.vehicle, bare, rng)
    return models


def _rows(
    count: int, kind: str, scores: list[FlightScores], found: dict[tuple[int, str], list[FlightScores]]
) -> list[Row]:
    nominal = [float(own.mae.mean()) for own in found.get((count, "nominal"), [])]
    name = f"{kind}_{count}"
    late = [float(np.nanmean(own.mae_after)) for own in scores]
    rows = mean_rows(f"mae_{name}", [float(own.mae.mean()) for own in scores], "V", "nominal", nominal)
    rows += mean_rows(f"mae_after_{name}", late, "V", "after 5 s", [])
    rows += mean_rows(f"z2_{name}", [float(own.z2.mean()) for own in scores], "1", "calibrated", [1.0])
    rows += mean_rows(f"coverage_{name}", [float(own.coverage.mean()) for own in scores], "1", "95 %", [0.95])
    return rows + mean_rows(f"nlpd_t_{name}", [float(own.nlpd_t.mean()) for own in scores], "nat", "", [])
