"""Choices in learning from one short log, compared by blocks left out of the training part of real logs.

No test block of `real_logs` is in anything here. Of the other sixteen blocks every fold leaves out those of
one remainder modulo five, with the same gap; the first and the last block of a log are never left out, since
no test block lies at an end.

    python -m etude_studies.real_choices [FOLDER]
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from etude.models import (
    COUNT,
    EVERY,
    FIRST,
    Kernel,
    Linear,
    LinearPhysics,
    SquaredExponential,
    near_times,
    structured,
)
from etude.types import Array, Column, Log, Samples
from etude_arm import filter_cutoff
from etude_studies.real_logs import REAL_LOGS, arm_log
from etude_studies.rows import Row
from etude_studies.world import World

SEED = 0


@dataclass(frozen=True)
class Choice:
    """One way of learning: keys of [model] and [data] that differ from those of the default process alone.

    With `other`, each output takes that kernel if it errs less on stretches left out in training.
    """

    model: dict[str, Any] = field(default_factory=dict)
    data: dict[str, Any] = field(default_factory=dict)
    other: str = ""


@dataclass(frozen=True)
class LeftOut:
    """Squared errors of samples left out, (folds, J) sums over those that move; `spread` (J,) of all."""

    process: Array
    linear: Array
    stacked: Array
    spread: Array

    def nmse(self, errors: Array) -> Array:
        """(J,) of one of the three above."""
        return np.asarray(errors.sum(axis=0) / self.spread)


def inertia(columns: Sequence[Column], commands: tuple[str, ...]) -> Kernel:
    """The structured kernel, and an inertia that depends on the posture."""
    return structured(columns, commands) + _of_order(columns, 2) * _posture(columns)


def rigid_body(columns: Sequence[Column], commands: tuple[str, ...]) -> Kernel:
    """The same with products of velocities too: the terms of a rigid body."""
    speeds = _of_order(columns, 1)
    products = (_of_order(columns, 2) + speeds * speeds) * _posture(columns)
    return structured(columns, commands) + products


def _of_order(columns: Sequence[Column], order: int) -> Linear:
    return Linear(_places(columns, order))


def _posture(columns: Sequence[Column]) -> SquaredExponential:
    return SquaredExponential(_places(columns, 0), unit=True, share=2.0)


def _places(columns: Sequence[Column], order: int) -> tuple[int, ...]:
    """Columns of positions, velocities or accelerations."""
    named = list(dict.fromkeys(channel for channel, *_ in columns))[order]
    return tuple(i for i, (channel, _, _, op) in enumerate(columns) if channel == named and not op)


HERE = "etude_studies.real_choices"
CHOICES: dict[str, Choice] = {
    "default": Choice(),
    "inertia": Choice({"kernel": f"{HERE}:inertia"}),
    "rigid_body": Choice({"kernel": f"{HERE}:rigid_body"}),
    "rigid_body_or_not": Choice(other=f"{HERE}:rigid_body"),
    "noise_floor_auto": Choice({"noise_floor": "auto"}),
    "samples_150": Choice(data={"least_samples": 150}),
    "samples_600": Choice(data={"least_samples": 600}),
    "ard_se": Choice({"kernel": "ard_se"}),
}


def choice_rows(logs: Path | None = None, *, only: Sequence[str] = ()) -> list[Row]:
    """`held_<choice>_<log>`: mean nMSE over the outputs of samples left out, beside that of the default.

    `gain_<choice>` is the geometric mean of the ratio to the default over all outputs of all logs, and
    `stacked_<log>` weighs linear regression in where the other folds say so.

    Args:
        logs: folder with Panda's recording. only: names of the logs to take, all arms' if empty.
    """
    baselines = {name: left_out(CHOICES["default"], *arm) for name, arm in _arms(logs, only)}
    rows = [_stacked_row(name, one) for name, one in baselines.items()]
    for choice, options in CHOICES.items():
        ratios = []
        for name, arm in _arms(logs, only):
            base, one = baselines[name], left_out(options, *arm)
            mine, theirs = one.nmse(one.process), base.nmse(base.process)
            ratios.append(mine / theirs)
            row = Row(f"held_{choice}_{name}", float(mine.mean()), "1", "the default", float(theirs.mean()))
            rows.append(row)
        gain = float(np.exp(np.log(np.concatenate(ratios)).mean()))
        rows.append(Row(f"gain_{choice}", gain, "1", "the default, all outputs", 1.0))
    return rows


def left_out(choice: Choice, log: Log, world: World) -> LeftOut:
    """What one choice makes of the folds of one log."""
    errors, linears, held = [], [], []
    for train, test in folds(log, world, choice):
        moving = test.usable & test.moving
        errors.append(np.where(moving, predicted(choice, world, train, test) - test.command, 0.0))
        line = LinearPhysics(world.inputs(world.alone))(train).predict(test.log)
        linears.append(np.where(moving, line - test.command, 0.0))
        held.append(np.where(moving, test.command, np.nan))
    command = np.concatenate(held)
    return LeftOut(
        np.array([(e**2).sum(axis=0) for e in errors]),
        np.array([(e**2).sum(axis=0) for e in linears]),
        stacked_errors(errors, linears),
        np.nanvar(command, axis=0) * np.isfinite(command).sum(axis=0),
    )


def predicted(choice: Choice, world: World, train: Samples, test: Samples) -> Array:
    """Commands (n, J) of the test by the process of that choice."""
    config = replace(world.alone, **{"rung": "gp", **choice.model})
    selection = world.learned(train, config, np.random.default_rng(SEED), body=False)
    mean = selection.model.mean(test.log)
    if not choice.other:
        return mean
    other = world.learned(
        train, replace(config, kernel=choice.other), np.random.default_rng(SEED), body=False
    )
    return np.where(other.errors["gp"] < selection.errors["gp"], other.model.mean(test.log), mean)


def stacked_errors(process: Sequence[Array], linear: Sequence[Array]) -> Array:
    """Squared errors (folds, J) with linear regression weighed in, by one weight for each output.

    The weight in [0, 1] is that of least squared error on the other folds.
    """
    out = []
    for k in range(len(process)):
        mine = np.concatenate([e for i, e in enumerate(process) if i != k])
        step = mine - np.concatenate([e for i, e in enumerate(linear) if i != k])
        weight = np.clip((mine * step).sum(axis=0) / np.maximum((step**2).sum(axis=0), 1e-300), 0.0, 1.0)
        out.append(((process[k] + weight * (linear[k] - process[k])) ** 2).sum(axis=0))
    return np.array(out)


def folds(log: Log, world: World, choice: Choice) -> Iterator[tuple[Samples, Samples]]:
    """Training and left-out samples, of the training part alone."""
    data = replace(world.config.data, **choice.data)
    samples, gap = world.samples(log, data=data), 1.0 / filter_cutoff(log, data)
    block = np.argsort(np.argsort(samples.t, kind="stable")) * COUNT // len(samples)
    test = block % EVERY == FIRST
    training = ~test & ~near_times(samples.t, test, gap)
    for remainder in sorted(set(range(EVERY)) - {FIRST}):
        block_test = training & (block % EVERY == remainder) & (block > 0) & (block < COUNT - 1)
        yield (
            samples.take(training & ~block_test & ~near_times(samples.t, block_test, gap)),
            samples.take(block_test),
        )


def _arms(logs: Path | None, only: Sequence[str]) -> Iterator[tuple[str, tuple[Log, World]]]:
    """Logs with times: SARCOS has none, and is no short log."""
    for real in REAL_LOGS:
        path = real.find(logs)
        if path is not None and real.name != "sarcos" and (not only or real.name in only):
            yield real.name, arm_log(real.name, path)


def _stacked_row(name: str, one: LeftOut) -> Row:
    alone = float(one.nmse(one.process).mean())
    return Row(f"stacked_{name}", float(one.nmse(one.stacked).mean()), "1", "the process alone", alone)


if __name__ == "__main__":
    from etude_studies.rows import table

    table(choice_rows(Path(sys.argv[1]) if len(sys.argv) > 1 else None), "real logs, blocks left out")
