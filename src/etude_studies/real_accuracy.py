"""How well models predict real arms: rows of the recordings in `real_logs`.

Held-out commands are low-pass filtered with the motion, as in every campaign; rows `_raw` compare with the
commands as recorded. The test blocks lie between training blocks of the same motion: this is interpolation.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError
from etude.models.blocks import linear_regression
from etude.models.calibration import score
from etude.models.inverse_dynamics import InverseDynamicsModel, train_model
from etude.models.ladder import train_ladder
from etude.models.model_config import ModelConfig
from etude_studies.real_logs import REAL_LOGS, Recording
from etude_studies.rows import Row

Array = NDArray[np.float64]


def real_rows(rng: np.random.Generator, *, logs: Path | None = None) -> list[Row]:
    """For every recording that is there, figures of the default process without a rigid body.

    `nmse_<log>`, `nmse_<log>_raw` and `nmse_<log>_worst_vs_linear`; `nmse_<log>_all_points` conditioned on
    all samples, where these are more than the default's cap; `nmse_<log>_ladder` of the default choice for a
    robot with a model file. Means over the joints, on samples where that joint moves. A log that should be
    there and is not has no row but a message on stderr; so has every output that fell back to linear
    regression.

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
    model = train_model(data.train, data.spec, ModelConfig(kind="gp"), rng)
    for message in model.warnings(data.spec.names):
        say(f"{name}, {message}")
    linear = linear_regression(data.train, data.test)
    rows = accuracy_rows(name, data.test.tau, _mean(model, data), linear, ~data.test.stuck, data.raw)
    if len(data.train) > ModelConfig().points:  # what the cap on the samples conditioned on costs
        every = train_model(data.train, data.spec, ModelConfig(kind="gp", points=len(data.train)), rng)
        rows.append(
            accuracy_rows(f"{name}_all_points", data.test.tau, _mean(every, data), linear, ~data.test.stuck)[
                0
            ]
        )
    if data.spec.model_file is not None:
        chosen = train_ladder(data.train, data.spec, ModelConfig(), rng).model
        ladder = accuracy_rows(f"{name}_ladder", data.test.tau, _mean(chosen, data), linear, ~data.test.stuck)
        rows.append(ladder[0])
    return rows


def accuracy_rows(
    name: str,
    tau: Array,
    mean: Array,
    linear: Array,
    moving: NDArray[np.bool_],
    raw: Array | None = None,
) -> list[Row]:
    """Rows of predictions `mean` of `tau`, both (n, k), beside `linear` regression's, where `moving`."""
    rows = []
    mine, theirs = (score(tau, predicted, None, moving).nmse for predicted in (mean, linear))
    beside = "linear regression"
    rows.append(Row(f"nmse_{name}", float(np.nanmean(mine)), "1", beside, float(np.nanmean(theirs))))
    if raw is not None:
        found, floor = (score(raw, predicted, None, moving).nmse for predicted in (mean, tau))
        noise = "what the filter took out of the command"
        rows.append(Row(f"nmse_{name}_raw", float(np.nanmean(found)), "1", noise, float(np.nanmean(floor))))
    worst = int(np.nanargmax(mine / theirs))
    ratio = float(mine[worst] / theirs[worst])
    rows.append(Row(f"nmse_{name}_worst_vs_linear", ratio, "1", f"no worse; output {worst + 1}", 1.0))
    return rows


def _mean(model: InverseDynamicsModel, data: Recording) -> Array:
    return model.predict(data.test.q, data.test.qd, data.test.qdd)[0]


def _check_folder(logs: Path | None) -> None:
    if logs is None:
        return
    wanted = [file for real in REAL_LOGS if not real.bundled for file in real.files]
    if not any((logs / file).is_file() for file in wanted):
        raise UsageError(
            "there is none of the recordings that are read from a folder",
            where=str(logs),
            next_step=f"Put one of {', '.join(wanted)} there; docs/real_logs.md says what they hold.",
        )


def say(text: str) -> None:
    """A line on stderr."""
    from rich.console import Console

    Console(stderr=True).print(text, highlight=False)
