"""etude study changed_robot: how soon a load or more friction is noticed, how often nothing is taken for it.

A cell is one robot and seed: a model of two random motions of a minute, ten unchanged runs of other motions,
and one run each with a fifth of the rated load, friction half as large again, and a sensor of one joint's
command that reads a twentieth of its range too much. Rated is the load with which no joint needs more than
half its command to stand anywhere inside its limits.
"""

from __future__ import annotations

import json as text
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from etude.models import ChangeTest, change_test, first_alarm
from etude.progress import counted
from etude.protocols import Trajectory
from etude.storage import write_atomic
from etude.types import Array, Log
from etude_studies.changed_rows import rows_of
from etude_studies.rows import rows_json, table
from etude_studies.seven_joints import SevenJoints
from etude_studies.world import World

ROBOTS = ("arm4", "arm4_rough", "seven_joints")
LOGS, UNCHANGED = 2, 10
LOAD, FRICTION, SENSOR = 0.2, 1.5, 0.05
POSES = 2000
OTHERS = (5.0, 7.0, 15.0, 20.0, 30.0)
"""Thresholds of which the cells keep the seconds too."""


def run(*, json: bool, seed: int, seeds: int, folder: Path) -> None:
    """Runs every cell that is no file in `folder` yet, and prints the rows."""
    cells: dict[str, list[dict[str, Any]]] = {robot: [] for robot in ROBOTS}
    for robot, cell_seed in counted([(robot, s) for robot in ROBOTS for s in range(seed, seed + seeds)]):
        cells[robot].append(cell(robot, cell_seed, folder))
    cells["all"] = [c for robot_cells in cells.values() for c in robot_cells]
    rows = [row for robot, robot_cells in cells.items() for row in rows_of(robot, robot_cells)]
    if json:
        print(rows_json(rows, f"etude study changed_robot --seed {seed} --seeds {seeds}"))  # noqa: T201
    else:
        table(rows, "Has the robot changed?")


def cell(robot: str, seed: int, folder: Path) -> dict[str, Any]:
    """What became of each run, from its file if the cell was run."""
    path = folder / f"{robot}_{seed:04d}.json"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        facts = measured(robot, seed)
        write_atomic(path, text.dumps(facts).encode())
    stored: dict[str, Any] = text.loads(path.read_bytes())
    return stored


@dataclass(frozen=True)
class Plant:
    """A simulated robot as the study uses it: how it runs, and what loads it can hold."""

    world: World
    made: Any

    @classmethod
    def of(cls, robot: str) -> Plant:
        if robot == "seven_joints":
            made = SevenJoints()
            return cls(made.world, made)
        world = World.of(robot)
        return cls(world, world.robot)

    def run(self, motion: Trajectory, rng: np.random.Generator, what: Mapping[str, float]) -> Log:
        robot = self.made.changed(**what) if what else self.made
        log: Log = robot.run(motion, None, rng)
        return log

    def rated(self) -> float:
        """kg, as the study's first lines say."""
        spec = self.world.spec
        q = np.random.default_rng(0).uniform(spec.lower, spec.upper, (POSES, spec.dof))
        still = np.zeros_like(q)
        bare, loaded = (
            robot.inverse(q, still, still) for robot in (self.made, self.made.changed(payload=1.0))
        )
        slope = loaded - bare
        room = 0.5 * spec.command - np.abs(bare)
        return float(np.min(np.maximum(room, 0.0) / np.maximum(np.abs(slope), 1e-9 * spec.command)))


def measured(robot: str, seed: int) -> dict[str, Any]:
    """Largest evidence and first alarm of each run, and what was named."""
    plant, rng = Plant.of(robot), np.random.default_rng([seed, 6])
    world = plant.world
    rated, joint = plant.rated(), seed % world.spec.dof
    logs = [plant.run(world.motion(rng), rng, {}) for _ in range(LOGS)]
    model = world.learned(world.samples(*logs), world.config.model, rng).model
    sensor = f"sensor_{world.spec.names[joint]}"
    whats: dict[str, dict[str, float]] = {
        **{f"unchanged_{i}": {} for i in range(UNCHANGED)},
        "load": {"payload": LOAD * rated},
        "friction": {"friction": FRICTION},
        "offset": {sensor: SENSOR * float(world.spec.command[joint])},
    }
    facts: dict[str, Any] = {"rated": rated, "worth": model.worth().tolist(), "freedom": model.freedom}
    for name, what in whats.items():
        samples = world.samples(plant.run(world.motion(rng), rng, what))
        facts[name] = facts_of(change_test(model, samples), samples.t)
    return facts


def facts_of(test: ChangeTest, t: Array) -> dict[str, Any]:
    """The test of one log as a cell keeps it; t (n,) s of motion."""
    return {
        "largest": float(test.evidence.max()),
        "alarm_s": None if test.alarm is None else float(t[test.alarm]),
        "others": {f"{alarm:g}": seconds_to(test.evidence, t, alarm) for alarm in OTHERS},
        "named": test.cause,
        "z2": test.z2,
    }


def seconds_to(path: Array, t: Array, alarm: float) -> float | None:
    """s of motion until the evidence is above that; None if it never is."""
    at = first_alarm(path, alarm)
    return None if at is None else float(t[at])
