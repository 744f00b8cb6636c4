"""etude study quadrotor_loop: what learned feedforward does to tracking, beside what there is without it.

A seed is four training flights under PID alone and eight test flights, all uniform on the feasible set, each
with its own noise; all variants of a seed fly the same tests. The error is the mean distance from the plan
after the first 5 s.
"""

from __future__ import annotations

import json as json_module
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from etude.errors import UsageError
from etude.protocols import Controller
from etude.storage import write_atomic
from etude.types import Log
from etude_quadrotor import (
    Disturbance,
    FlightFeedforward,
    GatedVoltages,
    QuadrotorInputs,
    Start,
    nominal_inverse,
)
from etude_studies.engines.each import each
from etude_studies.flight_world import THESIS_S, Flights
from etude_studies.rows import Row, mean_rows, rows_json, table

TESTS = 8
LEARNED_FROM = (1, 2, 4)
DISTURBANCES = {
    "calm": Disturbance(),
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
    errors_by_setting: dict[str, list[dict[str, float]]] = {}
    for done, (cell, errors) in enumerate(_run_all(cells, folder), start=1):
        _say(f"{done} of {len(cells)}: {cell.name}")
        errors_by_setting.setdefault(cell.setting, []).append(errors)
    rows = [row for setting, values in errors_by_setting.items() for row in loop_rows(setting, values)]
    if json:
        print(rows_json(rows, f"etude study quadrotor_loop --seed {seed} --seeds {seeds}"))  # noqa: T201
    else:
        table(rows, f"position error in the loop, {seeds} seeds from {seed}")


def loop_rows(setting: str, errors_of_seeds: list[dict[str, float]]) -> list[Row]:
    """Mean error of each variant over the seeds, with its interval, beside PID alone's in the same air."""
    rows = []
    for variant in errors_of_seeds[0]:
        air = variant.split("/")[1]
        reference = [errors[f"pid/{air}"] for errors in errors_of_seeds]
        values = [errors[variant] for errors in errors_of_seeds]
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
    rng, most = np.random.default_rng(cell.seed), max(learned_from)
    flights = Flights.of(cell.robot, "low", start=cell.start, harmonics=cell.harmonics, duration=THESIS_S)
    drawn = flights.drawn(rng, most + tests)
    controllers = _controllers(flights, flights.flown(drawn[:most], rng), learned_from, rng)
    errors: dict[str, float] = {}
    for air, disturbance in DISTURBANCES.items():
        robot = replace(flights.robot, air=disturbance)
        for name, controller in controllers.items():
            if air != "calm" and name not in DISTURBED:
                continue
            each = []
            for i, flight in enumerate(drawn[most:]):
                log = robot.test(flight, controller, np.random.default_rng([cell.seed, i]))
                each.append(robot.error(log)[0][-1])
            errors[f"{name}/{air}"] = float(np.mean(each))
    return errors


def _controllers(
    flights: Flights, logs: Sequence[Log], learned_from: tuple[int, ...], rng: np.random.Generator
) -> Mapping[str, Controller | None]:
    """What there is without learning, and what the first so many flights teach."""
    world = flights.world
    controllers = {
        "pid": None,
        "acceleration": FlightFeedforward(),
        **world.kind.baselines(world.spec, world.config),
    }
    nominal = nominal_inverse(flights.robot.vehicle.vehicle)
    for count in learned_from:
        model = world.learned(world.samples(*logs[:count]), world.config.model, rng).model
        process = model.of_structure("gp")
        rungs = {"": model, "_gp": process, "_residual": model.of_structure("identified+gp")}
        for name, model_of_rung in rungs.items():
            controllers[f"learned{name}_{count}"] = world.kind.controller(
                world.spec, world.config, model_of_rung
            )
        assert isinstance(model.inputs, QuadrotorInputs)
        controllers[f"learned_drag_only_{count}"] = FlightFeedforward(drag=model.inputs.lateral)
        controllers[f"gp_voltage_only_{count}"] = FlightFeedforward(voltages=GatedVoltages(process, nominal))
    return controllers


def _run_all(cells: list[Cell], folder: Path) -> Iterator[tuple[Cell, dict[str, float]]]:
    return each(partial(run_one, folder=folder), cells)


def _say(text: str) -> None:
    from rich.console import Console

    Console(stderr=True).print(text, highlight=False)
