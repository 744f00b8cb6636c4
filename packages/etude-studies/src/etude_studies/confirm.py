"""etude study confirm: does the forecast of the error with the feedforward hold, joint by joint?

A cell is one robot and seed: a model of four random motions of a minute; its test motions, another random
one, and the same in which one joint rests, one moves by a fiftieth and one by a fifth. Each runs without and
with the feedforward. What is counted is the error of a joint while it moves over the middle of its forecast.
"""

from __future__ import annotations

import json as text
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from etude.campaign import errors, left_over, moving, trained_speeds, without_it
from etude.models import LearnedModel
from etude.progress import counted
from etude.protocols import Controller, Trajectory
from etude.storage import write_atomic
from etude.types import Array, Log, Motion
from etude_studies.rows import Row, rows_json, table
from etude_studies.seven_loop import seven_loop
from etude_studies.world import World

ROBOTS = ("arm4", "arm4_rough", "seven_loop")
STREAM, NOISE_STREAM = 12, 13
LOGS = 4
"""The fewest with which a model is calibrated."""
PARTS = (0.0, 0.02, 0.2)
"""How far three joints in turn go in the last motion, beside the random one."""


def run(*, json: bool, seed: int, seeds: int, folder: Path) -> None:
    """Runs every cell that is no file in `folder` yet, and prints the rows."""
    cells = {
        (robot, s): folder / f"{robot}_{s:04d}.json" for robot in ROBOTS for s in range(seed, seed + seeds)
    }
    for (robot, s), path in counted(cells.items()):
        if not path.exists():
            folder.mkdir(parents=True, exist_ok=True)
            write_atomic(path, text.dumps(measured(robot, s)).encode())
    stored = {key: text.loads(path.read_bytes()) for key, path in cells.items()}
    rows = [
        row for robot in ROBOTS for row in rows_of(robot, [c for (r, _), c in stored.items() if r == robot])
    ]
    rows += rows_of("all", list(stored.values()))
    if json:
        print(rows_json(rows, f"etude study confirm --seed {seed} --seeds {seeds}"))  # noqa: T201
    else:
        table(rows, "Error with the feedforward over its forecast")


def rows_of(robot: str, cells: list[list[list[float | None]]]) -> list[Row]:
    """Quantiles over all joints that move in all motions, and how many lie inside the forecast."""
    every = [joint for cell in cells for joint in cell]
    pairs = np.array([joint[:2] for joint in every if joint[0] is not None], dtype=float)
    ratio = pairs[:, 0]
    sentence = f"of {len(ratio)}; nothing said of {len(every) - len(ratio)}"
    rows = [Row(f"inside_{robot}", float(pairs[:, 1].sum()), "1", sentence)]
    marks = {"least": 0.0, "q10": 0.1, "median": 0.5, "q90": 0.9, "most": 1.0}
    return rows + [Row(f"{name}_{robot}", float(np.quantile(ratio, q)), "1") for name, q in marks.items()]


def measured(robot: str, seed: int) -> list[list[float | None]]:
    """[error over the middle of its forecast, whether inside] of each joint and motion; None: not told."""
    made: Any = seven_loop() if robot == "seven_loop" else World.of(robot).robot
    world: World = made.world if robot == "seven_loop" else World.of(robot)
    kind, spec, config, rng = world.kind, world.spec, world.config, np.random.default_rng([seed, STREAM])
    logs = [made.run(world.motion(rng), None, rng) for _ in range(LOGS)]
    model = world.learned(world.samples(*logs), config.model, rng).model
    motions: list[Any] = [*kind.tests(spec, config, rng).values(), world.motion(rng)]
    factors = np.ones(spec.dof)
    factors[(seed + np.arange(len(PARTS))) % spec.dof] = PARTS
    controllers = (next(iter(kind.baselines(spec, config).values())), kind.controller(spec, config, model))
    return [
        joint
        for k, motion in enumerate([*motions, Partly(motions[-1], factors)])
        for joint in _joints(world, model, motion, [_run(made, motion, c, [seed, k]) for c in controllers])
    ]


def _run(made: Any, motion: Trajectory, controller: Controller | None, seed: list[int]) -> Log:
    log: Log = made.run(motion, controller, np.random.default_rng([*seed, NOISE_STREAM]))
    return log.take((log.t >= 0.0) & (log.t <= motion.duration))


def _joints(world: World, model: LearnedModel, motion: Any, logs: list[Log]) -> list[list[float | None]]:
    path = world.kind.path
    rates = next(c for c in world.kind.channels(world.spec) if c.derivative_of == path)
    trained = trained_speeds(model, rates)
    without, fed = logs
    commands = model.mean(model.inputs.states(motion.motion(without.t, model.inputs.orders)))
    forecast = without_it(without, path, motion, moving(motion, without.t, trained), commands)
    error = errors(fed, path, motion, moving(motion, fed.t, trained))
    left = left_over(model, motion, trained)
    middle = np.hypot(np.array(left, dtype=float) * forecast.moving, forecast.noise)
    return [
        [None, None] if interval is None else [float(e / m), float(interval[0] <= e <= interval[1])]
        for e, m, interval in zip(error, middle, forecast.expected(left), strict=True)
    ]


@dataclass(frozen=True, eq=False)
class Partly:
    """Another motion, of which each joint goes a part of the way (enough of a `protocols.Trajectory`)."""

    once: Trajectory
    factors: Array

    @property
    def form(self) -> str:
        return self.once.form

    @property
    def duration(self) -> float:
        return self.once.duration

    def motion(self, t: Array, orders: int = 3) -> Motion:
        """Each joint's way from where it starts, times its factor."""
        whole = self.once.motion(t, orders).orders
        start = self.once.motion(np.zeros(1), 1).orders[0, 0]
        offset = np.zeros_like(whole)
        offset[0] = (1.0 - self.factors) * start
        return Motion(t, whole * self.factors + offset)

    def pieces(self) -> tuple[tuple[float, str, Any], ...]:
        return ((0.0, "segment", self),)
