"""etude study design: what design is worth, by paired seeds, with scaled random motions always beside it.

The parts: the oracle bound (best, mean and worst of 20 candidates in hindsight), the first motion and those
after it, seconds to a given error by the length of segments, tasks, a fast arm of seven joints that served
for no choice of settings, flights of 15 and 30 s and the room they take. A cell is a part, an arm and a
seed; each is a file, so that an interrupted study goes on.
"""

from __future__ import annotations

import json as text
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from etude.progress import counted
from etude.storage import write_atomic
from etude_studies.design_parts import LENGTHS, LONGEST, PARTS, Cell
from etude_studies.paired import paired
from etude_studies.rows import Row, mean_rows, rows_json, table

GOALS = (0.5, 0.3, 0.2)
"""deg of tracking error that segment lengths are compared by."""


def run(*, json: bool, seed: int, seeds: int, folder: Path) -> None:
    """Runs every cell that is no file in `folder` yet, seed by seed, and prints the rows of all."""
    for cell_seed in counted(range(seed, seed + seeds)):
        for part, (_, arms) in counted(PARTS.items()):
            for arm in counted(arms):
                cell(part, arm, cell_seed, folder)
    rows = rows_of(folder, range(seed, seed + seeds))
    if json:
        print(rows_json(rows, f"etude study design --seed {seed} --seeds {seeds}"))  # noqa: T201
    else:
        table(rows, f"What design is worth, {seeds} seeds from {seed}")


def cell(part: str, arm: str, seed: int, folder: Path) -> Cell:
    """What was measured, from its file if the cell was run."""
    path = folder / f"{part}_{arm}_{seed:04d}.json"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        write_atomic(path, text.dumps(PARTS[part][0](arm, seed), indent=1).encode())
    stored: Cell = text.loads(path.read_bytes())
    return stored


def rows_of(folder: Path, seeds: Sequence[int]) -> list[Row]:
    """The rows of all cells in the folder; parts that have fewer than two seeds are left out."""
    rows: list[Row] = []
    for part, (_, arms) in PARTS.items():
        for arm in arms:
            paths = [folder / f"{part}_{arm}_{seed:04d}.json" for seed in seeds]
            cells: list[Cell] = [text.loads(path.read_bytes()) for path in paths if path.exists()]
            if len(cells) >= 2:
                rows += _part_rows(part, arm, cells)
    return rows


def _part_rows(part: str, arm: str, cells: list[Cell]) -> list[Row]:
    unit = UNITS.get(part, "deg")
    rows = []
    for key in cells[0]:
        values = [c[key] for c in cells]
        name = f"{part}_{arm}_{key}".replace(" ", "_")
        figure_unit = "s" if key.endswith("seconds") else unit
        rows += mean_rows(name, values, figure_unit, "", [])[:1]
        for beside in _beside(key, cells[0]):
            rows += ratio_rows(name, values, [c[beside] for c in cells], beside)
    return rows + (seconds_rows(arm, cells) if part == "lengths" else [])


UNITS = {"chain": "%", "flights": "m", "room": "1"}
"""Of errors, where they are no angles."""
AGAINST: dict[str, tuple[str, ...]] = {
    "designed": ("random", "repeated"),
    "without": ("random",),
    "with": ("random",),
    "itself": ("random",),
    "random": ("repeated",),
    "best": ("mean",),
    "worst": ("mean",),
    "15-s": ("30-s",),
}
"""What is held against what: random motions, one that is repeated; of an oracle the mean;
of short flights long ones."""


def _beside(key: str, cell: Cell) -> list[str]:
    """The figures that one is held against."""
    first, _, suffix = key.partition(" ")
    names = [] if suffix == "seconds" else [f"{other} {suffix}" for other in AGAINST.get(first, ())]
    return [name for name in names if name in cell]


def ratio_rows(name: str, values: Sequence[float], references: Sequence[float], beside: str) -> list[Row]:
    """Geometric mean of paired ratios with its 95 % t-interval, and the worst seeds."""
    ratio = paired(values, references)
    over = f"{name}_over_{beside.partition(' ')[0]}"
    return [
        Row(over, ratio.ratio, "1", f"{ratio.count} seeds"),
        Row(f"{over}_low", ratio.low, "1", "95 %"),
        Row(f"{over}_high", ratio.high, "1", "95 %"),
        Row(f"{over}_worst", float(max(values)), "as above", "the other's worst", float(max(references))),
    ]


def seconds_rows(arm: str, cells: list[Cell]) -> list[Row]:
    """Median seconds of motion until the error is at most each goal; `LONGEST` where it never was."""
    rows = []
    for what in ("designed", "random"):
        for segment in LENGTHS:
            for goal in GOALS:
                until = [_seconds(arm_cell, f"{what} {segment:g} s after ", goal) for arm_cell in cells]
                rows.append(
                    Row(
                        f"seconds_{arm}_{what}_{segment:g}_to_{goal:g}",
                        float(np.median(until)),
                        "s",
                        "median",
                    )
                )
    return rows


def _seconds(cell: Cell, start: str, goal: float) -> float:
    reached = [float(k.removeprefix(start)) for k, v in cell.items() if k.startswith(start) and v <= goal]
    return min(reached, default=2.0 * LONGEST)
