"""The models' tables of chapter 6 on a recorded log: the same rows, judged on blocks of it that are left out.

A fold in the place of a seed. Its training part is learned in six pieces, as the thesis learns trajectories.
The error is the mean absolute error of the command on the blocks left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from etude.errors import UsageError
from etude.models import LinearPhysics, near_times
from etude.threads import threads_for
from etude.types import Array, Log, Mask, Samples
from etude_arm import filter_cutoff
from etude_studies.collected import Results
from etude_studies.measured import Measured, measured_table
from etude_studies.thesis.arm import joint_rows
from etude_studies.thesis.arm_runs import ARM_RUNS, ROUNDS
from etude_studies.thesis.arm_settings import ArmSettings
from etude_studies.thesis.ledger import Claim, Entry, Ledger
from etude_studies.thesis.parts import run_of
from etude_studies.world import World

BLOCKS = 20
TRAJECTORY = 6000
"""Samples of a trajectory of the thesis; points and spectral points shrink with shorter pieces."""
SCALED = ("points", "fit_points", "basis")
FEWEST = 40
STRETCHES = 10
"""Of each piece, all over the log: a joint may stand for a whole sixth of it."""
MEASURE, TEST = "error", "fourier"
"""The keys under which tables and claims look for it."""


@dataclass(frozen=True, eq=False)
class Recorded:
    """A log with its robot, and the folds of it.

    Attributes:
        robot: file of its description. log: cleaned.
        folds: 2 to 20; fold f leaves out blocks f, f + folds, ... of 20.
    """

    robot: Path
    log: Log
    folds: int

    @classmethod
    def of(cls, path: Path, robot: Path | None, folds: int | None) -> Recorded:
        """The log of a file; its robot's file is asked for beside it, named as the folder, if not given.

        Raises:
            UsageError: there is no such robot, it is no arm, or so many folds cannot be. DataError: the log.
        """
        folds = folds or BLOCKS
        if not 2 <= folds <= BLOCKS:
            step = f"Give 2 to {BLOCKS}."
            raise UsageError(f"{folds} folds cannot be left out", where="--seeds", next_step=step)
        robot = robot or path.with_name(f"{path.parent.name}.toml")
        world = World.of(robot)
        if world.kind.name != "arm":
            raise UsageError(
                "these tables are of arms", where=str(robot), next_step="Give the robot.toml of an arm."
            )
        return cls(robot, world.read(path), folds)

    def results(self, runs: Sequence[str]) -> Results:
        """Every figure of these runs, a fold in the place of a seed."""
        import polars as pl

        tables = {}
        for run in runs:
            with threads_for(0):
                fold_tables = [measured_table(self._fold(run, fold), run) for fold in range(self.folds)]
            tables[run] = pl.concat(
                table.with_columns(pl.lit(fold, pl.Int32).alias("seed"))
                for fold, table in enumerate(fold_tables)
            )
        return Results(tables, {run: {"hashes": {}} for run in runs})

    def _fold(self, run: str, fold: int) -> Iterator[Measured]:
        all_samples = self._samples(self._settings({}))
        settings = self._settings(ARM_RUNS[run][1], len(all_samples) / ROUNDS / TRAJECTORY)
        world, samples = settings.world, self._samples(settings)
        edges = np.quantile(all_samples.t, np.linspace(0.0, 1.0, BLOCKS + 1)[1:-1])
        test = all_samples.take(self._left_out(all_samples.t, edges, fold))
        held = self._left_out(samples.t, edges, fold)
        gap = 1.0 / filter_cutoff(self.log, world.config.data)
        train = samples.take(~held & ~near_times(samples.t, held, gap))
        piece, model = np.arange(len(train)) * STRETCHES * ROUNDS // len(train) % ROUNDS, None
        for k in range(1, ROUNDS + 1):
            learned = replace(train, group=piece).take(piece < k)
            rng = np.random.default_rng([fold, k])
            model = world.learned(learned, settings.model_of(k), rng, model, body=False).model
            line = LinearPhysics(model.inputs)(learned).predict(test.log)
            for name, predicted in (("", model.mean(test.log)), ("linear", line)):
                yield from joint_rows(k, TEST, name, world, [(MEASURE, _error(predicted, test))])

    def _left_out(self, t: Array, edges: Array, fold: int) -> Mask:
        """Which of the times t (n,) lie in a block of the fold."""
        return np.asarray(np.searchsorted(edges, t, side="right") % self.folds == fold)

    def _samples(self, settings: ArmSettings) -> Samples:
        return settings.world.samples(self.log)

    def _settings(self, run: Mapping[str, Any], share: float = 1.0) -> ArmSettings:
        """A run's, on what was measured: a log has no plan. Sizes are for pieces of `share` trajectories."""
        keys = {**run, "data": {**run.get("data", {}), "inputs": "measured"}, "robot": str(self.robot)}
        config = ArmSettings(**keys).config.model
        sizes = {name: getattr(config, name) for name in SCALED}
        less = {name: max(FEWEST, round(size * min(1.0, share))) for name, size in sizes.items()}
        return ArmSettings(**{**keys, "model": {**run.get("model", {}), **less}})


def _error(predicted: Array, test: Samples) -> Array:
    """(J,) mean absolute error where the joint moves."""
    use = test.usable & test.moving
    return np.asarray(np.nanmean(np.where(use, np.abs(predicted - test.command), np.nan), axis=0))


def runs_on_logs(entry: Entry) -> list[str]:
    """Runs of an entry's rows that need no motion of their own. UsageError: there is none."""
    runs = [run_of(row.run) for row in entry.rows]
    fit = [run for run in runs if ARM_RUNS.get(run, ("", {"motions": "designed"}))[1].get("motions") is None]
    if entry.measure != MEASURE or not fit or len(fit) < len(runs):
        raise UsageError(
            f"{entry.id} does not compare models on given data",
            where="--logs",
            next_step="Take a table of 6.1 to 6.9, such as table-6.9.",
        )
    return list(dict.fromkeys(fit))


def entry_of_log(entry: Entry, world: World) -> Entry:
    """The entry with the robot's joints, and without what the thesis printed of its own arm."""
    rows = tuple(msgspec.structs.replace(row, printed=()) for row in entry.rows)
    return msgspec.structs.replace(
        entry,
        rows=rows,
        lines=(f"{rows[0].run}:linear",),
        columns=(*world.spec.names, "mean"),
        unit=world.spec.command_unit,
        title=f"error of the command after {entry.at[-1]} of {ROUNDS} pieces of the log",
        kind="table",
    )


def claims_of_log(ledger: Ledger, runs: Sequence[str], folds: int) -> tuple[Claim, ...]:
    """Claims whose every number is an error of these runs, a fold in the place of a seed."""
    return tuple(
        msgspec.structs.replace(claim, seeds=folds)
        for claim in ledger.claims
        if claim.parts
        and all(
            part.measure == MEASURE
            and part.test == TEST
            and part.part == "mean"
            and {run_of(one) for one in part.sources} <= {*runs}
            for part in claim.parts
        )
    )
