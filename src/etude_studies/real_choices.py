"""Choices in learning from one short log, compared by blocks left out of the training part of real logs.

No test block of `real_logs` is in anything here. Of the other sixteen blocks every fold leaves out those of
one remainder modulo five, with the same gap; the first and the last block of a log are never left out, since
no test block lies at an end.

    python -m etude_studies.real_choices [FOLDER]
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from etude.logs.log import RobotLog
from etude.models import output_process
from etude.models.blocks import COUNT, EVERY, FIRST, linear_regression, near
from etude.models.dataset import Dataset
from etude.models.gp.kernels import Kernel, Linear, SquaredExponential, structured_kernel
from etude.models.inverse_dynamics import train_model
from etude.models.lesson import Lesson
from etude.models.model_config import ModelConfig
from etude.models.preprocess import DataConfig, build_dataset, filter_cutoff, preset
from etude.robots.spec import RobotSpec
from etude_studies.real_logs import REAL_LOGS, arm_log
from etude_studies.rows import Row

Array = NDArray[np.float64]
Builder = Callable[[int, int, int], Kernel]
SEED = 0


@dataclass(frozen=True)
class Choice:
    """One way of learning: options of the model and of the data, and what is called a structured kernel.

    With `other`, each output takes that kernel if it gives stretches left out in training a higher density.
    """

    model: ModelConfig
    data: DataConfig
    kernel: Builder
    other: Builder | None = None


@dataclass(frozen=True)
class LeftOut:
    """Squared errors of samples left out, (folds, dof) sums over those that move; `spread` (dof,) of all."""

    process: Array
    linear: Array
    stacked: Array
    spread: Array

    def nmse(self, errors: Array) -> Array:
        """(dof,) of one of the three above."""
        return np.asarray(errors.sum(axis=0) / self.spread)


def _with_inertia(dof: int, axis: int, frictions: int = 1) -> Kernel:
    """The structured kernel, and an inertia that depends on the posture."""
    return structured_kernel(dof, axis, frictions) + _accelerations(dof) * _posture(dof)


def _with_rigid_body(dof: int, axis: int, frictions: int = 1) -> Kernel:
    """The same with products of velocities too: the terms of a rigid body."""
    speeds = Linear(tuple(range(dof, 2 * dof)))
    products = (_accelerations(dof) + speeds * speeds) * _posture(dof)
    return structured_kernel(dof, axis, frictions) + products


def _accelerations(dof: int) -> Linear:
    return Linear(tuple(range(2 * dof, 3 * dof)))


def _posture(dof: int) -> SquaredExponential:
    return SquaredExponential(tuple(range(dof)), unit=True, share=2.0)


DEFAULT = Choice(ModelConfig(kind="gp"), preset("default"), structured_kernel)
CHOICES: dict[str, Choice] = {
    "default": DEFAULT,
    "inertia": replace(DEFAULT, kernel=_with_inertia),
    "rigid_body": replace(DEFAULT, kernel=_with_rigid_body),
    "rigid_body_or_not": replace(DEFAULT, other=_with_rigid_body),
    "noise_floor_auto": replace(DEFAULT, model=ModelConfig(kind="gp", noise_floor="auto")),
    "samples_300": replace(DEFAULT, data=replace(preset("default"), least_samples=300)),
    "samples_600": replace(DEFAULT, data=replace(preset("default"), least_samples=600)),
    "ard_se": replace(DEFAULT, model=ModelConfig(kind="gp", kernel="ard_se")),
}


def choice_rows(logs: Path | None = None, *, only: Sequence[str] = ()) -> list[Row]:
    """`held_<choice>_<log>`: mean nMSE over the outputs of samples left out, beside that of the default.

    `gain_<choice>` is the geometric mean of the ratio to the default over all outputs of all logs, and
    `stacked_<log>` weighs linear regression in where the other folds say so.

    Args:
        logs: folder with Panda's recording. only: names of the logs to take, all arms' if empty.
    """
    found = {name: left_out(DEFAULT, *arm) for name, arm in _arms(logs, only)}
    rows = [_stacked_row(name, one) for name, one in found.items()]
    for choice, options in CHOICES.items():
        ratios = []
        for name, arm in _arms(logs, only):
            base, one = found[name], left_out(options, *arm)
            mine, theirs = one.nmse(one.process), base.nmse(base.process)
            ratios.append(mine / theirs)
            row = Row(f"held_{choice}_{name}", float(mine.mean()), "1", "the default", float(theirs.mean()))
            rows.append(row)
        gain = float(np.exp(np.log(np.concatenate(ratios)).mean()))
        rows.append(Row(f"gain_{choice}", gain, "1", "the default, all outputs", 1.0))
    return rows


def left_out(choice: Choice, log: RobotLog, spec: RobotSpec) -> LeftOut:
    """What one choice makes of the folds of one log."""
    errors, linears, held = [], [], []
    for train, test in folds(log, spec, choice.data):
        with structured_as(choice.kernel, choice.other):
            model = train_model(train, spec, choice.model, np.random.default_rng(SEED))
        moving = ~test.stuck
        errors.append(np.where(moving, model.predict(test.q, test.qd, test.qdd)[0] - test.tau, 0.0))
        linears.append(np.where(moving, linear_regression(train, test) - test.tau, 0.0))
        held.append(np.where(moving, test.tau, np.nan))
    tau = np.concatenate(held)
    return LeftOut(
        np.array([(e**2).sum(axis=0) for e in errors]),
        np.array([(e**2).sum(axis=0) for e in linears]),
        stacked_errors(errors, linears),
        np.nanvar(tau, axis=0) * np.isfinite(tau).sum(axis=0),
    )


def stacked_errors(process: Sequence[Array], linear: Sequence[Array]) -> Array:
    """Squared errors (folds, dof) with linear regression weighed in, by one weight for each output.

    The weight in [0, 1] is that of least squared error on the other folds.
    """
    out = []
    for k in range(len(process)):
        mine = np.concatenate([e for i, e in enumerate(process) if i != k])
        step = mine - np.concatenate([e for i, e in enumerate(linear) if i != k])
        weight = np.clip((mine * step).sum(axis=0) / np.maximum((step**2).sum(axis=0), 1e-300), 0.0, 1.0)
        out.append(((process[k] + weight * (linear[k] - process[k])) ** 2).sum(axis=0))
    return np.array(out)


def folds(log: RobotLog, spec: RobotSpec, data: DataConfig) -> Iterator[tuple[Dataset, Dataset]]:
    """Training and left-out samples, of the training part alone."""
    dataset, gap = build_dataset(log, spec, data), 1.0 / filter_cutoff(log, data)
    block = np.argsort(np.argsort(dataset.t, kind="stable")) * COUNT // len(dataset)
    test = block % EVERY == FIRST
    known = ~test & ~near(dataset.t, test, gap)
    for remainder in sorted(set(range(EVERY)) - {FIRST}):
        own = known & (block % EVERY == remainder) & (block > 0) & (block < COUNT - 1)
        yield dataset.take(known & ~own & ~near(dataset.t, own, gap)), dataset.take(own)


@contextmanager
def structured_as(builder: Builder, other: Builder | None = None) -> Iterator[None]:
    """Trains with another kernel in the place of the structured one, or with the better of two."""
    place = vars(output_process)
    own = {name: place[name] for name in ("structured_kernel", "_attempt")}
    asked: list[tuple[int, int, int]] = []

    def build(dof: int, axis: int, frictions: int) -> Kernel:
        asked.append((dof, axis, frictions))
        return builder(dof, axis, frictions)

    def better(lesson: Lesson, *options: object) -> object:
        attempts = [own["_attempt"](lesson, *options)]
        if other is not None:
            attempts.append(own["_attempt"](replace(lesson, kernel=other(*asked[-1])), *options))
        return max(attempts, key=lambda attempt: attempt.density)

    place.update(structured_kernel=build, _attempt=better)
    try:
        yield
    finally:
        place.update(own)


def _arms(logs: Path | None, only: Sequence[str]) -> Iterator[tuple[str, tuple[RobotLog, RobotSpec]]]:
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
