"""etude study watch: what is told of a robot that has changed, and how soon its errors are back.

A cell is one robot and seed. A model of two random motions of a minute is held against ten unchanged runs of
other motions, and one run each with a fifth of the rated load, friction half as large again, and one broken
sensor: a command with an offset of 15 % of its range, out of scale by 1.4 or stuck after 20 s, or an encoder
0.1 rad off. Of the first seeds also two rows of four runs: friction that grows from run to run, and friction
that is there from the third on. Cells of the recovery close the loop: see `watch_recovery`.
"""

from __future__ import annotations

import json as text
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from etude.models import ChangeTest, LearnedModel, change_test, drift_onset
from etude.storage import write_atomic
from etude.types import Log, Samples
from etude_studies.broken_sensors import FAULTS, broken
from etude_studies.changed_robot import FRICTION, LOAD, LOGS, ROBOTS, UNCHANGED, Plant, facts_of
from etude_studies.rows import rows_json, table
from etude_studies.watch_recovery import recovery_cells
from etude_studies.watch_rows import rows_of

STREAM, FAULT_STREAM, ROW_STREAM = 8, 9, 11
ROWS = 1
"""The first so many seeds have rows of runs."""
GROWING = tuple(1.0 + 0.25 * (FRICTION - 1.0) * (k + 1) for k in range(4))
SUDDEN = (1.0, 1.0, FRICTION, FRICTION)


def run(*, json: bool, seed: int, seeds: int, folder: Path) -> None:
    """Runs every cell that is no file in `folder` yet, one line for each, and prints the rows."""
    cells: dict[str, list[dict[str, Any]]] = {robot: [] for robot in ROBOTS}
    for s in range(seed, seed + seeds):
        for robot, robot_cells in cells.items():
            robot_cells.append(kept(folder / f"{robot}_{s:04d}.json", partial(measured, robot, s)))
    recovery = recovery_cells(seed, seeds, folder, kept)
    several = [
        kept(folder / f"rows_{robot}_{s:04d}.json", partial(several_runs, robot, s))
        for s in range(seed, seed + min(seeds, ROWS))
        for robot in ROBOTS
    ]
    rows = rows_of(cells, several, recovery)
    if json:
        print(rows_json(rows, f"etude study watch --seed {seed} --seeds {seeds}"))  # noqa: T201
    else:
        table(rows, "Watching a robot")


def kept(path: Path, measure: Any) -> dict[str, Any]:
    """The facts in a file, measured and written if there is none; a line on stderr says which."""
    from rich.console import Console

    new = not path.exists()
    if new:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, text.dumps(measure()).encode())
    facts: dict[str, Any] = text.loads(path.read_bytes())
    Console(stderr=True).print(f"{path.stem}: {'measured' if new else 'known'}", highlight=False)
    return facts


def measured(robot: str, seed: int) -> dict[str, Any]:
    """The test of every run of a cell."""
    plant, rng = Plant.of(robot), np.random.default_rng([seed, STREAM])
    world, model = plant.world, _learned(plant, rng)
    whats: dict[str, Mapping[str, float]] = {
        **{f"unchanged_{i}": {} for i in range(UNCHANGED)},
        "payload": {"payload": LOAD * plant.rated()},
        "friction": {"friction": FRICTION},
    }
    facts: dict[str, Any] = {"freedom": model.freedom}
    for name, what in whats.items():
        facts[name] = _facts(model, world.samples(plant.run(world.motion(rng), rng, what)))
    fault, joint = _fault(seed, world.spec.dof)
    log = broken(plant.made, world.motion(rng), rng, fault, joint, world.spec.command)
    facts["sensor"] = _facts(model, world.samples(log)) | {"fault": fault, "joint": joint}
    return facts


def several_runs(robot: str, seed: int) -> dict[str, Any]:
    """What is told of how the change came, of both rows of runs."""
    plant, rng = Plant.of(robot), np.random.default_rng([seed, ROW_STREAM])
    world, model = plant.world, _learned(plant, rng)
    onsets = {"robot": robot}
    for name, factors in (("growing", GROWING), ("sudden", SUDDEN)):
        runs: list[Log] = [plant.run(world.motion(rng), rng, {"friction": f}) for f in factors]
        onsets[name] = drift_onset([change_test(model, world.samples(log)).sizes for log in runs])
    return onsets


def _learned(plant: Plant, rng: np.random.Generator) -> LearnedModel:
    """The model of the robot as it was."""
    world = plant.world
    logs = [plant.run(world.motion(rng), rng, {}) for _ in range(LOGS)]
    return world.learned(world.samples(*logs), world.config.model, rng).model


def _fault(seed: int, joints: int) -> tuple[str, int]:
    """Which sensor is broken: all kinds in turn, a random joint; of the vertical first joint's encoder no
    command tells, so it is not asked.
    """
    fault = FAULTS[seed % len(FAULTS)]
    joint = int(np.random.default_rng([seed, FAULT_STREAM]).integers(fault == "encoder", joints))
    return fault, joint


def _facts(model: LearnedModel, samples: Samples) -> dict[str, Any]:
    test: ChangeTest = change_test(model, samples)
    return facts_of(test, samples.t)
