"""The Lagrangian prior on real logs, beside the default kernel: blocks and quarters left out.

    python -m etude_studies.real_lagrangian KEPT [FOLDER]

KEPT is a file of rows that are done, so that a run goes on where it was; FOLDER holds the recordings that are
not part of the project. Settings are those of the kernel's page in docs/models.md, for all logs the same.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from etude.models import Folds, fold_numbers, near_times, split_blocks
from etude.types import Array, Log, Samples
from etude_arm import filter_cutoff
from etude_lagrangian import all_lin, data_together
from etude_studies.real_logs import REAL_LOGS, arm_log
from etude_studies.rows import Row, table
from etude_studies.world import World

SEED = 0
QUARTERS = 4
FIT_POINTS = 110


@dataclass(frozen=True)
class Outcome:
    """Of each output, where its joint moves: samples, sums of commands, their squares and squared errors; and
    the seconds of CPU that learning and predicting took.
    """

    count: tuple[float, ...]
    total: tuple[float, ...]
    square: tuple[float, ...]
    error: tuple[float, ...]
    seconds: float


def outcome(test: Samples, mean: Array, seconds: float) -> Outcome:
    """Of predictions (n, J)."""
    use = test.usable & test.moving
    y, error = np.where(use, test.command, 0.0), np.where(use, test.command - mean, 0.0)
    count, total, square, off = (
        tuple(values.sum(axis=0).astype(float).tolist()) for values in (use, y, y**2, error**2)
    )
    return Outcome(count, total, square, off, seconds)


def nmse(parts: Sequence[Outcome]) -> Array:
    """(J,) squared errors of all parts over the commands' variance in all of them."""
    n, total, square, error = (
        np.sum([getattr(part, name) for part in parts], axis=0)
        for name in ("count", "total", "square", "error")
    )
    return np.asarray(error / (square - total**2 / n))


def splits(log: Log, world: World) -> Iterator[tuple[str, Samples, Samples]]:
    """Blocks as in `real_logs`, then each contiguous quarter, with the same gap."""
    samples, gap = world.samples(log), 1.0 / filter_cutoff(log, world.config.data)
    yield "blocks", *split_blocks(samples, gap_s=gap)
    rank = np.argsort(np.argsort(samples.t, kind="stable")) * QUARTERS // len(samples)
    for quarter in range(QUARTERS):
        test = rank == quarter
        train = ~test & ~near_times(samples.t, test, gap)
        yield f"quarter{quarter + 1}", samples.take(train), samples.take(test)


def default(world: World, train: Samples, test: Samples) -> Array:
    """Today's kernel, without other candidates."""
    config = replace(world.alone, rung="gp")
    selection = world.learned(train, config, np.random.default_rng(SEED), body=False)
    return selection.model.mean(test.log)


def gip_lin(world: World, train: Samples, test: Samples) -> Array:
    """Each command with a Lagrangian prior of its own, and friction."""
    config = replace(world.alone, rung="gp", kernel="gip_lin", steps=30, fit_points=FIT_POINTS)
    selection = world.learned(train, config, np.random.default_rng(SEED), body=False)
    return selection.model.mean(test.log)


def all_together(world: World, train: Samples, test: Samples) -> Array:
    """One energy for all commands, and friction of each."""
    return learned_together(world, train)(test.log)


def learned_together(world: World, train: Samples) -> Callable[[Log], Array]:
    """What predicts commands (n, J) of states, after `all_lin` has learned those of `train`."""
    config = replace(world.alone, steps=60, fit_points=FIT_POINTS)
    inputs = world.inputs(config).fitted(train)
    fold = fold_numbers(train, config.stretch_s)
    names = train.log.channels["command"].parts
    limit = world.kind.limit(world.spec)
    folds = Folds(train, inputs, inputs.of_log(train.log), fold, limit, config, names)
    data, units = data_together(folds, config.floors[0], None, np.random.default_rng(SEED))
    process = all_lin(data)
    return lambda states: np.asarray(units[0] + process.mean(inputs.of_log(states)))


CHOICES = {"default": default, "gip_lin": gip_lin, "all_lin": all_together}


def outcomes(file_path: Path, logs: Path | None) -> dict[str, Outcome]:
    """By "log/split/choice"; those in `file_path` are not computed again."""
    lines = file_path.read_text(encoding="utf-8").splitlines() if file_path.is_file() else []
    results = {name: Outcome(**row) for line in lines for name, row in json.loads(line).items()}
    for real in REAL_LOGS:
        path = real.find(logs)
        if path is None or real.name == "sarcos":  # which has no times
            continue
        log, world = arm_log(real.name, path)
        for split, train, test in splits(log, world):
            for choice, learn in CHOICES.items():
                name = f"{real.name}/{split}/{choice}"
                if name in results:
                    continue
                start = time.process_time()
                mean = learn(world, train, test)
                results[name] = outcome(test, mean, time.process_time() - start)
                with file_path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps({name: asdict(results[name])}) + "\n")
    return results


def rows(results: Mapping[str, Outcome]) -> list[Row]:
    """`<log>_<choice>` and `<log>_quarters_<choice>`: mean nMSE over the outputs, beside the default's; and
    `<log>_<choice>_cpu`, of the blocks.
    """
    made = []
    parts = {"": ("blocks",), "_quarters": tuple(f"quarter{i + 1}" for i in range(QUARTERS))}
    for log in dict.fromkeys(name.split("/")[0] for name in results):
        for title, kinds in parts.items():
            means = {
                choice: float(nmse([results[f"{log}/{kind}/{choice}"] for kind in kinds]).mean())
                for choice in CHOICES
            }
            made += [Row(f"{log}{title}_{c}", m, "1", "default", means["default"]) for c, m in means.items()]
        cpu = {choice: results[f"{log}/blocks/{choice}"].seconds for choice in CHOICES}
        made += [Row(f"{log}_{c}_cpu", seconds, "s", "default", cpu["default"]) for c, seconds in cpu.items()]
    return made


if __name__ == "__main__":
    table(rows(outcomes(Path(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) > 2 else None)), "real logs")
