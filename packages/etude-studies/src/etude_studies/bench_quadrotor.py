"""`etude bench quadrotor`: cost, orderings, calibration and tracking of flights, and what is asked of each.

A measure is a function of a random generator and `quick`, for a shorter form, that returns rows; `MEASURES`
lists them.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from etude.progress import counted
from etude.threads import threads_for
from etude_quadrotor import flight_plan
from etude_studies.crazyflie import crazyflie_rows
from etude_studies.flight_design_cost import design_rows
from etude_studies.flight_loop import Cell as LoopCell
from etude_studies.flight_loop import seed_errors
from etude_studies.flight_orders import EXTREME_SEEDS, Cell, designed_flights
from etude_studies.flight_orders_cell import EXTREME, Effort, cell_measures
from etude_studies.flight_orders_rows import (
    RANDOM,
    Cells,
    compare,
    compare_deviation,
    figures,
    ratio_rows,
)
from etude_studies.flight_orders_verdicts import CALIBRATED_FROM
from etude_studies.flight_world import Flights
from etude_studies.paired import Paired
from etude_studies.rows import Row, mean_rows, rows_json, table

REPEATS = 5
PRESET = "clean"
FULL = Effort(arms=(RANDOM, "mean_variance", "ivr"), flights=5)
QUICK = replace(FULL, flights=CALIBRATED_FROM, tests={"uniform": 12, "boundary": 2, "extremes": 8})
LEARNED = "learned_4"


def run(*, json: bool = False, seed: int = 0, quick: bool = False) -> list[Row]:
    """Measure all rows and print them: a table, or with `json` the one line of `rows_json`.

    `quick` measures the same rows with fewer seeds and flights, in less than five minutes of CPU.
    """
    rows: list[Row] = []
    with threads_for(0):
        for measure in MEASURES:
            rows += measure(np.random.default_rng(seed), quick)
    if json:
        command = "etude bench quadrotor --quick --json" if quick else "etude bench quadrotor --json"
        print(rows_json(rows, command))  # noqa: T201
    else:
        table(rows, "quadrotor")
    return rows


def flight_cost_rows(rng: np.random.Generator, quick: bool = False) -> list[Row]:  # noqa: ARG001
    """`flight_cpu_s`: CPU of one simulated flight of 30 s once compiled, the least of some."""
    flights = Flights.of("quadrotor", "mid")
    (flight,), plant = flights.drawn(rng, 1), flights.robot.vehicle
    plan = flight_plan(flight, None, plant.vehicle, plant.rate)
    costs = []
    for _ in range(REPEATS + 1):
        began = time.process_time()
        plant.fly(plan, rng, start="moving")
        costs.append(time.process_time() - began)
    return [Row("flight_cpu_s", min(costs[1:]), "s", "30 s flown at 1 kHz; required at most", 0.1)]


def order_bench_rows(
    rng: np.random.Generator, quick: bool = False, effort: Effort | None = None, seeds: int | None = None
) -> list[Row]:
    """Calibration and orderings in the clean preset, as `etude study quadrotor` finds them.

    `z2_uniform`: of the process after four uniform random flights, on uniform tests.
    `ivr_vs_random_mae_uniform`, `ivr_vs_random_sd`, `mean_variance_vs_random_extremes`: uniform random's
    figure over the criterion's after the last flight, above 1 where the criterion is better.
    """
    effort = effort or (QUICK if quick else FULL)
    cells = _cells(rng, effort, seeds or (5 if quick else 10), 2 if quick else len(EXTREME_SEEDS))
    last = min(CALIBRATED_FROM, effort.flights)
    z2 = figures(cells, RANDOM, last, "uniform", "z2")
    rows = mean_rows("z2_uniform", z2, "1", "calibrated; required 0.5 .. 2", [1.0])
    comparisons: dict[str, tuple[Paired, str]] = {
        "ivr_vs_random_mae_uniform": (
            compare(cells, "ivr", RANDOM, "uniform"),
            "required: upper end 1 or more",
        ),
        "ivr_vs_random_sd": (compare_deviation(cells, "ivr"), "common hyperparameters; required 1.05"),
        "ivr_vs_random_sd_in_use": (compare_deviation(cells, "ivr", "sd_in_use"), "models in use"),
        "mean_variance_vs_random_uniform": (
            compare(cells, "mean_variance", RANDOM, "uniform"),
            "expected below 1",
        ),
        "mean_variance_vs_random_extremes": (
            compare(cells, "mean_variance", RANDOM, "extremes"),
            "required 1.1",
        ),
    }
    for metric, (ratio, aim) in comparisons.items():
        rows += ratio_rows(metric, ratio, f"uniform random over it; {aim}")
    return rows


def _cells(rng: np.random.Generator, effort: Effort, seeds: int, sources: int) -> Cells:
    first = int(rng.integers(1000, 100_000))
    designed = [
        designed_flights(Cell(PRESET, source), effort)["flights"] for source in EXTREME_SEEDS[:sources]
    ]
    extremes = {
        criterion: [np.array(flight) for flights in designed for flight in flights[criterion]]
        for criterion in EXTREME
    }
    cell_seeds = counted(range(first, first + seeds), whole=0.5)
    return [cell_measures(PRESET, cell_seed, extremes, effort) for cell_seed in cell_seeds]


def tracking_rows(
    rng: np.random.Generator, quick: bool = False, seeds: int | None = None, tests: int | None = None
) -> list[Row]:
    """Position error after the first 5 s: `pid_error_m` of feedback alone, and with what four flights taught.

    `exact_drag_error_m` is the error of the analytic model that knows the drag.
    """
    first = int(rng.integers(1000, 100_000))
    cells = [
        LoopCell("quadrotor", "moving", 2, cell_seed)
        for cell_seed in range(first, first + (seeds or (3 if quick else 6)))
    ]
    errors = [seed_errors(cell, tests or (4 if quick else 8), (4,)) for cell in counted(cells, whole=0.5)]
    pid, exact, learned = (
        [errors_of_seed[f"{name}/calm"] for errors_of_seed in errors]
        for name in ("pid", "exact_drag", LEARNED)
    )
    rows = mean_rows("pid_error_m", pid, "m", "exact drag known", exact)
    rows += mean_rows("feedforward_error_m", learned, "m", "required at most", [0.06])
    return rows + mean_rows("exact_drag_error_m", exact, "m", "PID alone", pid)


MEASURES: tuple[Callable[[np.random.Generator, bool], list[Row]], ...] = (
    flight_cost_rows,
    lambda rng, _: design_rows(rng),
    order_bench_rows,
    tracking_rows,
    crazyflie_rows,
)
"""In the order they are run."""
