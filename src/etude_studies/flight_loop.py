"""etude study quadrotor_loop: what learned feedforward does to tracking, beside what there is without it.

A seed is four training flights under PID alone and eight test flights, all uniform on the feasible set, each
with its own noise; all variants of a seed fly the same tests. The error is the mean distance from the plan
after the first 5 s.
"""

from __future__ import annotations

import json as json_module
import os
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from etude.control.flight_feedforward import (
    PID_ALONE,
    FlightFeedforward,
    GatedVoltages,
    LinearDrag,
    flight_plan,
)
from etude.errors import UsageError
from etude.models.flight.config import PRESETS
from etude.models.flight.dataset import FlightDataset
from etude.models.flight.drag import train_drag
from etude.models.flight.ladder import train_flight_ladder
from etude.models.flight.preprocess import FlightDataConfig, build_flight_dataset, joined
from etude.models.physics.flight_inverse import nominal_inverse
from etude.plants.flight.disturbance import Disturbance
from etude.plants.flight.record import flight_log
from etude.plants.flight.registry import flight_plant
from etude.plants.flight.simulated import SimulatedVehicle, Start
from etude.robots.flight_spec import FlightSpec
from etude.robots.toml_file import load_robot
from etude.storage import write_atomic
from etude_studies.rows import Row, mean_rows, rows_json, table
from etude.trajectories.flight.family import FlightFamily
from etude.trajectories.flight.feasible import feasible_flights
from etude.trajectories.flight.samplers import uniform_parameters
from etude.trajectories.fourier import FourierTrajectory

TRAINING, TESTS = 4, 8
SETTLED_S = 5.0
LEARNED_FROM = (1, 2, 4)
DISTURBANCES = {
    "calm": None,
    "wind": Disturbance(wind=(2.0, 1.0, 0.0)),
    "gust": Disturbance(gust=(4.0, 0.0, 0.0), gust_start=10.0, gust_duration=5.0),
    "sag": Disturbance(sag=0.05, sag_rate=0.002),
}
"""What no model was told: 2.2 m/s of wind, a gust of 4 m/s, a supply that loses 5 % and 0.2 % a second."""
DISTURBED = ("pid", "exact_drag", "learned_4")


@dataclass(frozen=True)
class Cell:
    """One vehicle, start and seed."""

    robot: str
    start: Start
    harmonics: int
    seed: int

    @property
    def name(self) -> str:
        return f"{self.setting}_{self.seed:04d}"

    @property
    def setting(self) -> str:
        return f"{self.robot}_{self.start}_n{self.harmonics}"


SETTINGS: tuple[tuple[str, Start, int], ...] = (
    ("quadrotor", "moving", 2),
    ("quadrotor", "hover", 2),
    ("quadrotor", "moving", 5),
    ("quadrotor_rough", "moving", 2),
)


def run(*, json: bool, seed: int, seeds: int, folder: Path) -> None:
    """Runs seeds `seed` .. `seed + seeds - 1` of every setting and prints the rows.

    Raises:
        UsageError: fewer than two seeds, of which no interval can be made.
    """
    if seeds < 2:
        raise UsageError(f"an interval needs 2 seeds or more, not {seeds}")
    cells = [Cell(*setting, s) for setting in SETTINGS for s in range(seed, seed + seeds)]
    found: dict[str, list[dict[str, float]]] = {}
    for done, (cell, errors) in enumerate(_run_all(cells, folder), start=1):
        _say(f"{done} of {len(cells)}: {cell.name}")
        found.setdefault(cell.setting, []).append(errors)
    rows = [row for setting, values in found.items() for row in loop_rows(setting, values)]
    if json:
        print(rows_json(rows, f"etude study quadrotor_loop --seed {seed} --seeds {seeds}"))  # noqa: T201
    else:
        table(rows, f"position error in the loop, {seeds} seeds from {seed}")


def loop_rows(setting: str, found: list[dict[str, float]]) -> list[Row]:
    """Mean error of each variant over the seeds, with its interval, beside PID alone's in the same air."""
    rows = []
    for variant in found[0]:
        air = variant.split("/")[1]
        reference = [errors[f"pid/{air}"] for errors in found]
        values = [errors[variant] for errors in found]
        name = f"{setting}_{variant.replace('/', '_')}_m"
        rows += mean_rows(name, values, "m", "PID alone, same air", reference)
    return rows


def run_one(cell: Cell, folder: Path) -> tuple[Cell, dict[str, float]]:
    """Errors by "variant/air", m; kept in a file, and read from it if it is there."""
    path = folder / f"{cell.name}.json"
    if path.exists():
        return cell, json_module.loads(path.read_text(encoding="utf-8"))
    errors = seed_errors(cell)
    write_atomic(path, json_module.dumps(errors).encode())
    return cell, errors


def seed_errors(
    cell: Cell, tests: int = TESTS, learned_from: tuple[int, ...] = LEARNED_FROM
) -> dict[str, float]:
    """Mean error over the test flights of every variant, in calm air and of some in disturbed, m."""
    rng = np.random.default_rng(cell.seed)
    plant, spec, flights = _setting(cell, rng, max(learned_from) + tests)
    training, tested = flights[: max(learned_from)], flights[max(learned_from) :]
    data = joined([_flown(cell, plant, spec, f, rng, n) for n, f in enumerate(training)])
    variants = _variants(plant, data, learned_from, rng)
    errors: dict[str, float] = {}
    for air, disturbance in DISTURBANCES.items():
        for name, feedforward in variants.items():
            if disturbance is not None and name not in DISTURBED:
                continue
            each = [
                _error(cell, plant, flight, feedforward, disturbance, np.random.default_rng([cell.seed, i]))
                for i, flight in enumerate(tested)
            ]
            errors[f"{name}/{air}"] = float(np.mean(each))
    return errors


def _setting(
    cell: Cell, rng: np.random.Generator, count: int
) -> tuple[SimulatedVehicle, FlightSpec, list[FourierTrajectory]]:
    plant, spec = flight_plant(cell.robot), load_robot(cell.robot).flight
    assert spec is not None
    family = FlightFamily(cell.harmonics)
    drawn = uniform_parameters(rng, feasible_flights(spec, family), count)
    return replace(plant, noise="low"), spec, [family.trajectory(p) for p in drawn]


def _flown(
    cell: Cell,
    plant: SimulatedVehicle,
    spec: FlightSpec,
    flight: FourierTrajectory,
    rng: np.random.Generator,
    number: int,
) -> FlightDataset:
    plan = flight_plan(flight, PID_ALONE, plant.vehicle, plant.rate)
    log = flight_log(plant.fly(plan, rng, start=cell.start), plan, spec.rate, averaged=True)
    return build_flight_dataset(log, spec, FlightDataConfig(), number)


def _variants(
    plant: SimulatedVehicle, data: FlightDataset, learned_from: tuple[int, ...], rng: np.random.Generator
) -> Mapping[str, FlightFeedforward]:
    nominal = nominal_inverse(plant.vehicle)
    exact = plant.parameters.drag_per_mass
    drag = LinearDrag((exact[0], exact[1], exact[2]))
    variants = {
        "pid": PID_ALONE,
        "acceleration": FlightFeedforward(),
        "analytic": FlightFeedforward(voltages=nominal),
        "exact_drag": FlightFeedforward(drag=drag, voltages=nominal),
    }
    for count in learned_from:
        part = data.take(data.group < count)
        learned, ladder = train_drag(part), train_flight_ladder(part, plant.vehicle, PRESETS["default"], rng)
        voltages = {
            f"learned_{count}": ladder.model,
            f"learned_gp_{count}": ladder.models["gp"],
            f"learned_residual_{count}": ladder.models["identified+gp"],
        }
        for name, model in voltages.items():
            variants[name] = FlightFeedforward(drag=learned, voltages=GatedVoltages(model, nominal))
        variants[f"learned_drag_only_{count}"] = FlightFeedforward(drag=learned)
        variants[f"gp_voltage_only_{count}"] = FlightFeedforward(
            voltages=GatedVoltages(ladder.models["gp"], nominal)
        )
    return variants


def _error(
    cell: Cell,
    plant: SimulatedVehicle,
    flight: FourierTrajectory,
    feedforward: FlightFeedforward,
    disturbance: Disturbance | None,
    rng: np.random.Generator,
) -> float:
    """Mean distance after the start, m; a flight that ends early goes on with its last distance."""
    plan = flight_plan(flight, feedforward, plant.vehicle, plant.rate)
    flown = plant.fly(plan, rng, start=cell.start, disturbance=disturbance)
    away = np.linalg.norm(flown.position - plan.position[: len(flown)], axis=1)
    whole = np.append(away, np.full(len(plan) - len(flown), away[-1]))
    return float(whole[plan.t >= SETTLED_S].mean())


def _run_all(cells: list[Cell], folder: Path) -> Iterator[tuple[Cell, dict[str, float]]]:
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as pool:
        yield from pool.map(partial(run_one, folder=folder), cells)


def _say(text: str) -> None:
    from rich.console import Console

    Console(stderr=True).print(text, highlight=False)
