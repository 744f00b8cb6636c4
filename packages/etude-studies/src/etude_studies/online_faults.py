"""etude study online_faults: robots go on learning through injected faults; does learning ever harm?

A cell is a robot and a seed: a model of two motions, a learner that has run a minute of a third one, and that
motion again with each fault. Every fault runs with learning and with the trained model alone; robot, motion,
noise and fault are the same. A finished fault is a file in the folder and is not run again.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from etude.errors import UsageError
from etude.protocols import Controller, Trajectory
from etude.storage import write_atomic
from etude.threads import threads_for
from etude.types import Array, Log
from etude_online import OnlineConfig, OnlineModel
from etude_studies.faults import KINDS, LENGTH_S, NEVER, Fault, FaultyWire, change, drawn
from etude_studies.online import TRAINING, feedback
from etude_studies.rows import Row, rows_json, table
from etude_studies.world import World, one_period

PASS_S = 60.0
RECOVERY_S, LAST_S, WINDOW_S, STEP_S = 15.0, 10.0, 5.0, 0.5
CLEAN = "clean"
BAR = 1.2
"""Times the error without learning that the error with it shall never exceed."""


@dataclass(frozen=True)
class Place:
    """A robot of the study.

    Attributes:
        name: a built-in robot's, or "seven". rung: that goes on learning. method: how.
        draws: faults of each kind in a cell. most: seeds at most; seven joints take ten times as long.
    """

    name: str
    rung: str
    draws: int = 3
    most: int = 1000
    method: str = "variance"


PLACES = (
    Place("arm4", "gp"),
    Place("arm4_rough", "gp"),
    Place("seven", "identified+gp", draws=1, most=1),
)


class FaultResult(msgspec.Struct, frozen=True):
    """One fault.

    Attributes:
        fault: as drawn. frozen, learned: mean tracking error from the onset to the end, the robot's unit.
        window: worst ratio of 5 s windows. recovered: ratio in the last 10 s; None if the fault lasts longer.
        largest: largest error, frozen and learned. reports: sentences.
    """

    fault: dict[str, Any]
    frozen: float
    learned: float
    window: float
    recovered: float | None
    largest: tuple[float, float]
    reports: list[str]

    @property
    def ratio(self) -> float:
        """Error with learning over that without."""
        return self.learned / self.frozen


@dataclass(frozen=True, eq=False)
class Shortened:
    """The beginning of a motion (a `protocols.Trajectory`)."""

    whole: Trajectory
    duration: float

    def __getattr__(self, name: str) -> Any:
        return getattr(self.whole, name)


@dataclass(frozen=True, eq=False)
class Stage:
    """A cell ready for faults: the trained model's controller, and a learner that has run for a minute."""

    world: World
    motion: Trajectory
    frozen: Controller
    online: OnlineModel
    warm: Any
    seed: int

    def run(self, fault: Fault, *, learning: bool) -> Log:
        """One run under a fault; the noise is the same in every run of a cell."""
        robot: Any = self.world.robot
        controller: Controller = self.frozen
        if learning:
            self.online.restore(self.warm)
            self.online.reports.clear()
            controller = self.online
        wire = FaultyWire(controller, fault, self.world.kind.path, self.world.kind.limit(self.world.spec))
        changes = {}
        if fault.kind in ("payload", "friction"):
            changes = {fault.onset: robot.changed(**change(fault))}
            changes |= {fault.end: robot} if fault.end < LENGTH_S else {}
        noise = np.random.default_rng([self.seed, 3])
        with threads_for(0):
            log: Log = robot.run(Shortened(self.motion, LENGTH_S), wire, noise, changes=changes)
        return log


@cache
def world_of(name: str) -> World:
    """A built-in robot, or an arm of seven joints under drives that its model file gives it."""
    if name == "seven":
        from etude_studies.seven_joints import PANDA_LIKE, described

        return described(0.0, PANDA_LIKE)
    return World.of(name)


def stage(place: Place, seed: int) -> Stage:
    """Trains, and lets the learner run for a minute."""
    world = world_of(place.name)
    rng = np.random.default_rng([seed, 17])
    motions = [world.motion(rng, **one_period(PASS_S)) for _ in range(TRAINING)]
    logs = [world.robot.run(motion, None, rng) for motion in motions]
    config = replace(world.alone, rung=place.rung)  # type: ignore[arg-type]
    model = world.learned(world.samples(*logs), config, rng).model
    frozen = world.kind.controller(world.spec, world.config, model)
    online = OnlineModel(
        model,
        world.kind.channels(world.spec),
        frozen,
        world.command_limits,
        OnlineConfig(place.method),
        world.spec.rate,
        rng,
        feedback(world, logs),
    )
    motion = world.motion(rng, harmonics=2, **one_period(PASS_S))
    with threads_for(0):
        world.robot.run(motion, online, np.random.default_rng([seed, 2]))
    return Stage(world, motion, frozen, online, online.state(), seed)


def errors(log: Log) -> Array:
    """(T,) |wanted - true| at t >= 0, mean over the axes."""
    path = "q_true" if "q_true" in log else "position"
    desired = log["q_des" if path == "q_true" else "position_des"]
    distance: Array = np.abs(desired - log[path])[log.t >= 0.0].mean(axis=1)
    return distance


def compared(fault: Fault, frozen: Log, learned: Log, reports: list[str]) -> FaultResult:
    """Figures of a pair of runs."""
    a, b = errors(frozen), errors(learned)
    rate = len(a) / LENGTH_S
    first = round(fault.onset * rate)
    width, step = round(WINDOW_S * rate), round(STEP_S * rate)
    starts = range(first, len(a) - width + 1, step)
    window = max(b[k : k + width].mean() / a[k : k + width].mean() for k in starts)
    last = slice(len(a) - round(LAST_S * rate), None)
    done = fault.end <= LENGTH_S - RECOVERY_S
    return FaultResult(
        asdict(fault) | {"end": min(fault.end, 1e9)},
        float(a[first:].mean()),
        float(b[first:].mean()),
        float(window),
        float(b[last].mean() / a[last].mean()) if done else None,
        (float(a[first:].max()), float(b[first:].max())),
        reports,
    )


def faults_of(place: Place, seed: int, kinds: Sequence[str] = KINDS) -> Iterator[tuple[str, Fault]]:
    """Every fault of a cell by name, the clean run first; none depends on which others there are."""
    parts = len(world_of(place.name).command_limits[0])
    yield CLEAN, Fault(CLEAN, 2.0, NEVER, 0, 0.0, 0)
    for number, kind in enumerate(KINDS):
        rng = np.random.default_rng([seed, 31, number])
        for draw in range(place.draws):
            fault = drawn(kind, parts, rng)
            if kind in kinds:
                yield f"{kind}_{draw}", fault


def run_cell(place: Place, seed: int, folder: Path, kinds: Sequence[str] = KINDS) -> dict[str, FaultResult]:
    """All faults of a cell, from their files where they were run."""
    results: dict[str, FaultResult] = {}
    ready: Stage | None = None
    alone: Log | None = None
    for name, fault in faults_of(place, seed, kinds):
        path = folder / f"{place.name}_{seed:04d}_{name}.json"
        if not path.exists():
            ready = stage(place, seed) if ready is None else ready
            if fault.of_robot or alone is None:
                frozen = ready.run(fault, learning=False)
                alone = alone if fault.of_robot else frozen
            else:
                frozen = alone
            learned = ready.run(fault, learning=True)
            sentences = [sentence for _, sentence in ready.online.reports]
            folder.mkdir(parents=True, exist_ok=True)
            write_atomic(path, msgspec.json.encode(compared(fault, frozen, learned, sentences)))
        results[name] = msgspec.json.decode(path.read_bytes(), type=FaultResult)
    return results


def run(*, json: bool, seed: int, seeds: int, folder: Path) -> None:
    """Runs seeds `seed` .. `seed + seeds - 1` of every robot, one after the other, and prints the rows."""
    if seeds < 1:
        raise UsageError(f"{seeds} seeds", next_step="Give one or more.")
    from rich.console import Console

    results: list[tuple[str, str, FaultResult]] = []
    for cell_seed in range(seed, seed + seeds):
        for place in PLACES:
            if cell_seed - seed >= place.most:
                continue
            cell = run_cell(place, cell_seed, folder)
            results += [(place.name, name, one) for name, one in cell.items()]
            worst = max(one.ratio for one in cell.values())
            Console(stderr=True).print(
                f"{place.name}, seed {cell_seed}: worst ratio {worst:.2f}", highlight=False
            )
    rows = study_rows(results)
    if json:
        print(rows_json(rows, f"etude study online_faults --seed {seed} --seeds {seeds}"))  # noqa: T201
    else:
        table(rows, f"learning through faults, {seeds} seeds from {seed}")


def study_rows(results: Sequence[tuple[str, str, FaultResult]]) -> list[Row]:
    """Worst and median ratios by kind of fault, by robot and of all."""
    clean = [one for _, name, one in results if name == CLEAN]
    faulty = [(robot, name.rpartition("_")[0], one) for robot, name, one in results if name != CLEAN]
    rows = _ratios("clean", clean)
    for kind in KINDS:
        rows += _ratios(kind, [one for _, fault_kind, one in faulty if fault_kind == kind])
    for place in PLACES:
        rows += _ratios(f"robot_{place.name}", [one for robot, _, one in faulty if robot == place.name])
    every = [one for *_, one in faulty]
    rows += _ratios("all", every)
    if every:
        above = sum(one.ratio > BAR for one in every)
        rows.append(Row("faults_above_bar", above, "1", f"of so many faults above {BAR}", len(every)))
        windows = sum(one.window > BAR for one in every)
        rows.append(Row("windows_above_bar", windows, "1", "with a 5 s window above it, of", len(every)))
    return rows


def _ratios(name: str, results: Sequence[FaultResult]) -> list[Row]:
    if not results:
        return []
    ratios = [one.ratio for one in results]
    back = [one.recovered for one in results if one.recovered is not None]
    rows = [
        Row(f"{name}_ratio_worst", max(ratios), "1", "runs", float(len(ratios))),
        Row(f"{name}_ratio_median", float(np.median(ratios)), "1"),
        Row(f"{name}_window_worst", max(one.window for one in results), "1"),
    ]
    return rows + ([Row(f"{name}_recovered_worst", max(back), "1", "runs", float(len(back)))] if back else [])


def fault_of(stored: Mapping[str, Any]) -> Fault:
    """The fault of a file."""
    return Fault(**{**stored, "end": stored["end"] if stored["end"] < 1e9 else NEVER})
