"""Accuracy of models on real arms: rows of the recordings in `real_logs`.

Held-out commands are low-pass filtered with the motion, as in every campaign; rows `_raw` compare with the
commands as recorded. The test blocks lie between training blocks of the same motion: this is interpolation.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError
from etude.models import LearnedModel, LinearPhysics, ModelConfig, figures, while_any_moves
from etude.types import Array, joined_samples
from etude_studies.real_logs import REAL_LOGS, Recording
from etude_studies.rows import Row


def real_rows(rng: np.random.Generator, *, logs: Path | None = None) -> list[Row]:
    """For every recording that is there, figures of the default model without a rigid body.

    `nmse_<log>`, `nmse_<log>_raw` and `nmse_<log>_worst_vs_linear`; `nmse_<log>_all` with the samples at
    which that joint stands while another moves; `nmse_<log>_all_points` conditioned on
    all samples, where these are more than the default's cap; `nmse_<log>_ladder` of the default choice for a
    robot with a model file. Means over the joints, else on samples where that joint moves. A log that should
    be there and is not has no row but a message on stderr; so has every output that linear regression
    predicts better.

    Args:
        logs: folder with recordings that are not part of the project.

    Raises:
        UsageError: no such folder, or none of the recordings in it. DataError: a damaged recording.
    """
    _check_folder(logs)
    rows: list[Row] = []
    for real in REAL_LOGS:
        path = real.find(logs)
        if path is None:
            if real.bundled:
                say(f"nmse_{real.name} left out: there is no {real.files[0]}; install etude again.")
            continue
        if real.note:
            say(real.note)
        rows += recording_rows(real.name, real.load(path), rng)
    return rows


def recording_rows(name: str, data: Recording, rng: np.random.Generator) -> list[Row]:
    """The rows of one recording."""
    world, test = data.world, data.test
    config, use = world.config.model, test.usable & test.moving
    model = world.learned(data.train, config, rng, body=False).model
    for notice in model.warnings:
        say(f"{name}, {notice}")
    linear = LinearPhysics(model.inputs)(data.train).predict(test.log)
    mean = model.mean(test.log)
    rows = accuracy_rows(name, test.command, mean, linear, use, data.raw)
    if not use.all():
        every = while_any_moves(test)
        rows.append(accuracy_rows(f"{name}_all", test.command, mean, linear, every)[0])

    def row(more: str, other: LearnedModel) -> Row:
        return accuracy_rows(f"{name}_{more}", test.command, other.mean(test.log), linear, use)[0]

    if data.quarters:
        rows.append(quarters_row(name, data, config, rng))
    if len(data.train) > config.points:  # what the cap on the samples conditioned on costs
        exact = replace(config, points=len(data.train), inducing=0)
        rows.append(row("all_points", world.learned(data.train, exact, rng, body=False).model))
    if world.kind.physics(world.spec, world.config):
        rows.append(row("ladder", world.learned(data.train, config, rng).model))
    return rows


def quarters_row(name: str, data: Recording, config: ModelConfig, rng: np.random.Generator) -> Row:
    """nMSE over all quarters together, each predicted from the other three."""
    tests, means, linears = [], [], []
    for train, test in data.quarters:
        model = data.world.learned(train, config, rng, body=False).model
        tests.append(test)
        means.append(model.mean(test.log))
        linears.append(LinearPhysics(model.inputs)(train).predict(test.log))
    test = joined_samples(tests)
    use = test.usable & test.moving
    whole = (np.concatenate(means), np.concatenate(linears))
    return accuracy_rows(f"{name}_quarters", test.command, *whole, use)[0]


def accuracy_rows(
    name: str,
    command: Array,
    mean: Array,
    linear: Array,
    moving: NDArray[np.bool_],
    raw: Array | None = None,
) -> list[Row]:
    """Rows of predictions `mean` of `command`, both (n, k), beside `linear` regression's, where `moving`."""
    rows = []
    mine, theirs = (figures(command, predicted, None, moving).nmse for predicted in (mean, linear))
    beside = "linear regression"
    rows.append(Row(f"nmse_{name}", float(np.nanmean(mine)), "1", beside, float(np.nanmean(theirs))))
    if raw is not None:
        scores, floor = (figures(raw, predicted, None, moving).nmse for predicted in (mean, command))
        noise = "what the filter took out of the command"
        rows.append(Row(f"nmse_{name}_raw", float(np.nanmean(scores)), "1", noise, float(np.nanmean(floor))))
    worst = int(np.nanargmax(mine / theirs))
    ratio = float(mine[worst] / theirs[worst])
    rows.append(Row(f"nmse_{name}_worst_vs_linear", ratio, "1", f"no worse; output {worst + 1}", 1.0))
    return rows


def _check_folder(logs: Path | None) -> None:
    if logs is None:
        return
    expected = [file for real in REAL_LOGS if not real.bundled for file in real.files]
    if not any((logs / file).is_file() for file in expected):
        raise UsageError(
            "there is none of the recordings that are read from a folder",
            where=str(logs),
            next_step=f"Put one of {', '.join(expected)} there; docs/real_logs.md says what they hold.",
        )


def say(text: str) -> None:
    """A line on stderr."""
    from rich.console import Console

    Console(stderr=True).print(text, highlight=False)
