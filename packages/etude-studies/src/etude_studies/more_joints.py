"""etude study more_joints: how the cost of learning and of design grows with the number of joints.

A robot of two arms (`two_arms`), simulated from its model file. A seed's model learns two random motions of a
minute; then the next one is designed, and a motion that was never trained on is followed.
"""

from __future__ import annotations

import json as text
import time
from pathlib import Path
from typing import Any

import numpy as np

from etude.design import Design, design
from etude.models import ModelSelection
from etude.progress import counted
from etude.storage import write_atomic
from etude_studies.rows import Row, mean_rows, rows_json, table
from etude_studies.two_arms import two_arms
from etude_studies.world import World

JOINTS = (6, 7, 10, 14)
LOGS = 2
TEST = "fourier"
FIGURES = {
    "training_cpu": "s",
    "design_cpu": "s",
    "run_cpu": "s",
    "error_pd": "deg",
    "error_identified": "deg",
    "error_learned": "deg",
    "error_perfect": "deg",
}
"""What a cell measures, and its unit. CPU seconds of one thread; errors are means over the joints."""


def run(*, json: bool, seed: int, seeds: int, folder: Path) -> None:
    """Measures every number of joints and seed, and prints the rows; finished ones are files in `folder`."""
    rows: list[Row] = []
    for joints in counted(JOINTS):
        cells = [cell(joints, s, folder) for s in counted(range(seed, seed + seeds))]
        for name, unit in FIGURES.items():
            rows += mean_rows(f"{name}_{joints}", [c[name] for c in cells], unit, "", [])
    command = f"etude study more_joints --seed {seed} --seeds {seeds}"
    if json:
        print(rows_json(rows, command))  # noqa: T201
    else:
        table(rows, "What more joints cost")


def cell(joints: int, seed: int, folder: Path) -> dict[str, float]:
    """The figures of one robot and seed, from its file if they were measured."""
    path = folder / f"{joints:02d}_{seed:04d}.json"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        write_atomic(path, text.dumps(measured(two_arms(joints), seed)).encode())
    stored: dict[str, float] = text.loads(path.read_bytes())
    return stored


def measured(world: World, seed: int) -> dict[str, float]:
    """CPU of training, design and a simulated minute; errors before and after learning."""
    rng = np.random.default_rng([seed, 1])
    robot = world.robot
    began = time.process_time()
    logs = [robot.run(world.motion(rng), None, rng) for _ in range(LOGS)]
    run_cpu = (time.process_time() - began) / LOGS
    samples = world.samples(*logs)
    began = time.process_time()
    selection = world.learned(samples, world.config.model, rng)
    training_cpu = time.process_time() - began
    proposal = designed(world, selection, seed)
    return {
        "training_cpu": training_cpu,
        "design_cpu": float(proposal.seconds),
        "run_cpu": run_cpu,
        **errors(world, selection, seed),
    }


def designed(world: World, selection: ModelSelection, seed: int) -> Design:
    """The motion after those that the model has learned."""
    kind, spec, config, model = world.kind, world.spec, world.config, selection.model
    place = kind.family(spec, config), kind.limits(spec, config, None, {}), kind.home(spec)
    options: dict[str, Any] = {"rate": float(spec.rate), "physics": kind.physics(spec, config)}
    rng = np.random.default_rng([seed, 2])
    return design(*place, model.inputs, model, config.design, rng, **options)


def errors(world: World, selection: ModelSelection, seed: int) -> dict[str, float]:
    """Mean tracking error of a test motion, deg, under each controller."""
    kind, spec, config, robot = world.kind, world.spec, world.config, world.robot
    motion = kind.tests(spec, config, np.random.default_rng([seed, 3]))[TEST]
    by_rung = {"identified": selection.model.of_structure("identified"), "learned": selection.model}
    controllers = {
        **kind.baselines(spec, config),
        **{name: kind.controller(spec, config, model) for name, model in by_rung.items()},
    }
    return {
        f"error_{name}": float(
            np.mean(robot.error(robot.run(motion, controller, np.random.default_rng([seed, 4])))[0])
        )
        for name, controller in controllers.items()
    }
