"""etude study online: the simulated arms go on learning while they run, and after they have changed.

A cell starts from a model of two motions, and repeats a motion that the model has not seen, three passes of a
minute, once for every rule; all rules of a cell see the same motion, robot and noise. A finished cell is a
file in the folder and is not run again.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from etude.errors import UsageError
from etude.models import LearnedModel
from etude.protocols import Robot, Trajectory
from etude.storage import write_atomic
from etude.threads import threads_for
from etude.types import Array, Log
from etude_online import Feedback, OnlineConfig, OnlineModel, feedback_of
from etude_studies.engines.each import each
from etude_studies.online_run import OnlineRun, Repeated, Watched
from etude_studies.rows import Row, mean_rows, rows_json, table
from etude_studies.world import World, one_period

PASSES, PASS_S = 3, 60.0
TRAINING = 2
CHANGE_S = PASS_S
"""The robot changes after the first pass."""
CHANGES: dict[str, dict[str, float]] = {
    "same": {},
    "friction": {"friction": 1.5},
    "payload": {"payload": 0.5},
}
"""What happens to it, as `Robot.changed` takes it."""
HALF_LIFE_S = 30.0
RULES: dict[str, OnlineConfig | None] = {
    "none": None,
    "variance": OnlineConfig("variance"),
    "error": OnlineConfig("error"),
    "ssgp": OnlineConfig("ssgp"),
    "sogp": OnlineConfig("sogp"),
}
UNGUARDED: dict[str, OnlineConfig | None] = {
    "error_literal_unguarded": OnlineConfig("error_literal", guarded=False),
    "variance_unguarded": OnlineConfig("variance", guarded=False),
}
FORGETTING: dict[str, OnlineConfig | None] = {
    "variance_forgetting": OnlineConfig("variance", half_life=HALF_LIFE_S),
    "variance_forgetting_unguarded": OnlineConfig("variance", half_life=HALF_LIFE_S, guarded=False),
    "ssgp_forgetting": OnlineConfig("ssgp", half_life=HALF_LIFE_S),
}
PLACES: dict[tuple[str, str], dict[str, OnlineConfig | None]] = {
    ("arm4", "same"): RULES | UNGUARDED,
    ("arm4_rough", "same"): RULES,
    ("arm4", "friction"): RULES | FORGETTING,
    ("arm4", "payload"): RULES | FORGETTING,
}


class Outcome(msgspec.Struct, frozen=True):
    """One rule in one cell.

    Attributes:
        errors: (passes, J) mean tracking error, degrees.
        predict_us, update_us: median and 99th percentile of a tick's time; updates of ticks that learned.
    """

    errors: list[list[float]]
    predict_us: tuple[float, float]
    update_us: tuple[float, float]


@dataclass(frozen=True)
class Cell:
    """A robot, what happens to it ("same", "friction", "payload"), and a seed."""

    robot: str
    change: str
    seed: int

    def path(self, folder: Path) -> Path:
        return folder / f"{self.robot}_{self.change}_{self.seed:04d}.json"


def run(*, json: bool, seed: int, seeds: int, folder: Path) -> None:
    """Runs seeds `seed` .. `seed + seeds - 1` of every place and prints the rows.

    Raises:
        UsageError: fewer than two seeds, of which no interval can be made.
    """
    if seeds < 2:
        raise UsageError(f"an interval needs 2 seeds or more, not {seeds}")
    cells = [Cell(*place, s) for place in PLACES for s in range(seed, seed + seeds)]
    outcomes = {}
    for done, (cell, cell_outcomes) in enumerate(_run_all(cells, folder), start=1):
        outcomes[cell] = cell_outcomes
        _say(f"{done} of {len(cells)} cells: {cell.path(folder).stem}")
    rows = study_rows(outcomes)
    if json:
        print(rows_json(rows, f"etude study online --seed {seed} --seeds {seeds}"))  # noqa: T201
    else:
        table(rows, f"learning on line, {seeds} seeds from {seed}")


def _say(text: str) -> None:
    from rich.console import Console

    Console(stderr=True).print(text, highlight=False)


def _run_all(cells: list[Cell], folder: Path) -> Iterator[tuple[Cell, dict[str, Outcome]]]:
    return zip(cells, each(partial(run_cell, folder=folder), cells), strict=True)


def run_cell(cell: Cell, folder: Path) -> dict[str, Outcome]:
    """All rules of one cell, from its file if it has been run."""
    path = cell.path(folder)
    if path.exists():
        return msgspec.json.decode(path.read_bytes(), type=dict[str, Outcome])
    cell_outcomes = outcomes_of(cell, PLACES[cell.robot, cell.change])
    folder.mkdir(parents=True, exist_ok=True)
    write_atomic(path, msgspec.json.encode(cell_outcomes))
    return cell_outcomes


def outcomes_of(cell: Cell, rules: dict[str, OnlineConfig | None]) -> dict[str, Outcome]:
    """Trains, and runs the test motion under each of the rules."""
    world = World.of(cell.robot)
    rng = np.random.default_rng([cell.seed, 0])
    model, logs = start_model(world, rng)
    feedback_law = feedback(world, logs)
    motion = world.motion(rng, harmonics=2, **one_period(PASS_S))
    change = {CHANGE_S: world.robot.changed(**CHANGES[cell.change])}
    return {
        name: _outcome(world, run_rule(world, model, motion, config, cell.seed, change, feedback_law))
        for name, config in rules.items()
    }


def start_model(world: World, rng: np.random.Generator) -> tuple[LearnedModel, list[Log]]:
    """What a campaign without a model file knows after two random motions under feedback alone, and their
    logs.
    """
    motions = (world.motion(rng, **one_period(PASS_S)) for _ in range(TRAINING))
    logs = [world.robot.run(motion, None, rng) for motion in motions]
    return world.learned(world.samples(*logs), replace(world.config.model, rung="gp"), rng).model, logs


def feedback(world: World, logs: Sequence[Log]) -> Feedback:
    """As the robot's own logs tell it."""
    channels = world.kind.channels(world.spec)
    return feedback_of(logs, channels, world.kind.path, world.command_limits, world.spec.rate)


def run_rule(
    world: World,
    model: LearnedModel,
    motion: Trajectory,
    config: OnlineConfig | None,
    seed: int,
    changes: Mapping[float, Robot],
    feedback_law: Feedback | None = None,
) -> OnlineRun:
    """All passes under one rule; the same seed gives every rule the same encoder noise.

    `feedback_law` is the robot's feedback, by which the guard judges; without it past samples alone judge.
    """
    frozen = world.kind.controller(world.spec, world.config, model)
    watched = None
    if config is not None:
        channels, limits = world.kind.channels(world.spec), world.command_limits
        generator = np.random.default_rng([seed, 1])
        rate = world.spec.rate
        watched = Watched(OnlineModel(model, channels, frozen, limits, config, rate, generator, feedback_law))
    robot: Any = world.robot
    noise = np.random.default_rng([seed, 2])
    with threads_for(0):
        log = robot.run(Repeated(motion, PASSES), watched or frozen, noise, changes=changes)
    return OnlineRun(log, PASSES, watched)


def _outcome(world: World, run: OnlineRun) -> Outcome:
    errors = [world.robot.error(part)[0].tolist() for part in run.passes()]
    if run.watched is None:
        return Outcome(errors, (0.0, 0.0), (0.0, 0.0))
    learned = run.watched.times("observe")[run.watched.learned > 0]
    updates = _median_p99(learned) if len(learned) else (0.0, 0.0)
    return Outcome(errors, _median_p99(run.watched.times("command")), updates)


def _median_p99(seconds: Array) -> tuple[float, float]:
    median, high = 1e6 * np.percentile(seconds, [50.0, 99.0])
    return float(median), float(high)


def study_rows(outcomes: dict[Cell, dict[str, Outcome]]) -> list[Row]:
    """`<robot>_<change>_<rule>_pass<k>` beside the same pass without updates; paired gains; latencies."""
    rows = []
    for robot, change in PLACES:
        selected = [
            cell_outcomes
            for cell, cell_outcomes in outcomes.items()
            if (cell.robot, cell.change) == (robot, change)
        ]
        for rule in PLACES[robot, change] if selected else ():
            name = f"{robot}_{change}_{rule}"
            for k in range(PASSES):
                without, errors = (_means(selected, r, k) for r in ("none", rule))
                rows += mean_rows(f"{name}_pass{k + 1}", errors, "deg", "without updates", without)
            gains = [a - b for a, b in zip(without, errors, strict=True)]
            if rule != "none":
                rows += mean_rows(f"{name}_gain", gains, "deg", "paired, last pass", [])
    return rows + _latency_rows(outcomes)


def _means(outcomes: list[dict[str, Outcome]], rule: str, k: int) -> list[float]:
    """Mean over the joints in pass k, one value per seed."""
    return [float(np.mean(by_rule[rule].errors[k])) for by_rule in outcomes]


def _latency_rows(outcomes: dict[Cell, dict[str, Outcome]]) -> list[Row]:
    """Medians over the cells of each tick's median and 99th percentile."""
    rows = []
    for rule in RULES:
        selected = [by_rule[rule] for by_rule in outcomes.values() if rule != "none" and rule in by_rule]
        for figure in ("predict_us", "update_us") if selected else ():
            median, high = np.median([getattr(outcome, figure) for outcome in selected], axis=0)
            rows.append(Row(f"{figure}_{rule}", float(median), "us", "99th percentile", float(high)))
    return rows
