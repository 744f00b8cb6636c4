"""etude study quadrotor: which flights teach best, under three random baselines and on three test sets.

Presets are in `flight_orders_world`. A cell is one seed of one preset: a common first flight, then five
flights in all for every arm (`flight_orders_cell`), and its figures in one JSON file, from which an
interrupted study goes on. Extreme tests are designed flights of seeds that are used for nothing else.
"""

from __future__ import annotations

import json as json_module
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from etude.campaign import preset_config
from etude.errors import UsageError
from etude.storage import write_atomic
from etude.threads import threads_for
from etude.types import Array
from etude_quadrotor import KIND
from etude_studies.engines.each import each
from etude_studies.flight_orders_cell import EXTREME, Effort, cell_measures, first_round, rounds
from etude_studies.flight_orders_rows import order_rows
from etude_studies.flight_orders_verdicts import verdict_rows
from etude_studies.flight_orders_world import PRESETS, World
from etude_studies.rows import rows_json, table

EXTREME_SEEDS = tuple(range(1_000_000, 1_000_005))
"""Their designed flights are the extreme tests; no cell may have one of these seeds."""
EXTREME_FLIGHTS = 3


@dataclass(frozen=True)
class Cell:
    """One seed of one preset; of the designs for extreme tests, if its seed is one of `EXTREME_SEEDS`."""

    preset: str
    seed: int

    @property
    def name(self) -> str:
        return f"{self.preset}_{self.seed:04d}"

    @property
    def designs(self) -> bool:
        """Whether its flights are tests of others."""
        return self.seed in EXTREME_SEEDS


def run(
    *,
    json: bool,
    seed: int,
    seeds: int,
    folder: Path,
    effort: Effort | None = None,
    workers: int | None = None,
) -> None:
    """Runs seeds `seed` .. `seed + seeds - 1` of every preset and prints rows and verdicts.

    Args:
        json: one line of JSON instead of tables. seed, seeds: which.
        folder: of the cells' files.
        effort: what each cell does. workers: processes; None for one a core.

    Raises:
        UsageError: fewer than two seeds, of which no interval can be made, or seeds kept for extreme tests.
    """
    if seeds < 2:
        raise UsageError(f"an interval needs 2 seeds or more, not {seeds}")
    cells_by_preset = study_cells(range(seed, seed + seeds), folder, effort or Effort(), workers)
    rows = [row for preset, cells in cells_by_preset.items() for row in order_rows(preset, cells)]
    rows += verdict_rows(cells_by_preset)
    if json:
        print(rows_json(rows, f"etude study quadrotor --seed {seed} --seeds {seeds}"))  # noqa: T201
    else:
        table(rows, f"which flights teach best, {seeds} seeds from {seed}")


def study_cells(
    seeds: range, folder: Path, effort: Effort, workers: int | None = None
) -> dict[str, list[dict[str, Any]]]:
    """The figures of every seed by preset, in the order of the seeds; computed where no file has them."""
    cells = [Cell(preset, flight_seed) for flight_seed in seeds for preset in PRESETS]
    reserved = [cell.seed for cell in cells if cell.designs]
    if reserved:
        raise UsageError(
            f"seed {reserved[0]} is kept for the extreme tests", next_step="Choose smaller seeds."
        )
    sources = [Cell(preset, flight_seed) for preset in PRESETS for flight_seed in EXTREME_SEEDS]
    extremes: dict[str, dict[str, list[Array]]] = {p: {name: [] for name in EXTREME} for p in PRESETS}
    cells_by_preset: dict[str, list[dict[str, Any]]] = {preset: [] for preset in PRESETS}
    designed = partial(extreme_cell, folder=folder, effort=effort)
    for cell, figures in _each(designed, sources, workers):
        for criterion, flights in figures["flights"].items():
            extremes[cell.preset][criterion] += [np.array(parameters) for parameters in flights]
    work = partial(ordinary_cell, folder=folder, effort=effort, extremes=extremes)
    for cell, figures in _each(work, cells, workers):
        cells_by_preset[cell.preset].append(figures)
    return cells_by_preset


def _each(
    work: Callable[[Cell], dict[str, Any]], cells: list[Cell], workers: int | None
) -> Iterator[tuple[Cell, dict[str, Any]]]:
    for done, (cell, figures) in enumerate(zip(cells, each(work, cells, workers), strict=True), start=1):
        _say(f"{done} of {len(cells)}: {cell.name}, {figures['cpu_s']:.0f} s of CPU")
        yield cell, figures


def ordinary_cell(
    cell: Cell, folder: Path, effort: Effort, extremes: Mapping[str, Mapping[str, list[Array]]]
) -> dict[str, Any]:
    """The figures of a cell, from its file if it is there."""
    tests = extremes[cell.preset]
    return _cached(cell, folder, effort, lambda: cell_measures(cell.preset, cell.seed, tests, effort))


def extreme_cell(cell: Cell, folder: Path, effort: Effort) -> dict[str, Any]:
    """Designed flights of a seed that no other cell has, by criterion; from its file if it is there."""
    return _cached(cell, folder, effort, lambda: designed_flights(cell, effort))


def designed_flights(cell: Cell, effort: Effort, flights: int = EXTREME_FLIGHTS) -> dict[str, Any]:
    """`flights[criterion]`: parameters of all flights after the first; `cpu_s`."""
    began, world = time.process_time(), World.of(cell.preset, effort.points)
    first = first_round(world, cell.seed, every_kind=False)
    designed = {}
    for criterion in EXTREME:
        *_, last = rounds(world, cell.seed, criterion, first, flights, effort, every_kind=False)
        designed[criterion] = [parameters.tolist() for parameters in last.parameters[1:]]
    return {"flights": designed, "cpu_s": time.process_time() - began}


def _cached(cell: Cell, folder: Path, effort: Effort, work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """What the cell's file says, if the same settings made it; else what `work` finds, written there."""
    path = folder / f"{cell.name}.json"
    campaign = asdict(preset_config(KIND, PRESETS[cell.preset].campaign))
    settings = json_module.loads(json_module.dumps([asdict(effort), asdict(PRESETS[cell.preset]), campaign]))
    if path.exists():
        stored: dict[str, Any] = json_module.loads(path.read_text(encoding="utf-8"))
        if stored["settings"] == settings:
            return stored
    with threads_for(0):
        figures = {"preset": cell.preset, "seed": cell.seed, "settings": settings, **work()}
    write_atomic(path, json_module.dumps(figures, allow_nan=False).encode())
    return figures


def _say(text: str) -> None:
    from rich.console import Console

    Console(stderr=True).print(text, highlight=False)
