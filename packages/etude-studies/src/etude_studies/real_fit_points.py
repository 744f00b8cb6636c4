"""Number of samples for the hyperparameters of a long log of seven joints: SARCOS, its training blocks alone.

The training part of `real_logs` in 16 blocks of equally many rows; every fourth is left out in turn. The
candidates and all else are the default's.

    python -m etude_studies.real_fit_points FOLDER
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from etude.errors import UsageError
from etude.models import USUAL_COMMANDS, figures
from etude.types import Samples
from etude_studies.real_logs import REAL_LOGS, Recording
from etude_studies.rows import Row, table

COUNTS = (300, 525, 1050)
"""Samples for hyperparameters, at most. The second is the default of seven joints, the first that of four."""
BLOCKS, EVERY = 16, 4


def fit_rows(logs: Path) -> list[Row]:
    """`nmse_<count>`: mean over outputs and folds; `cpu_<count>`: s of training, mean of the folds.

    Raises:
        UsageError: SARCOS is not in the folder.
    """
    real = next(recording for recording in REAL_LOGS if recording.name == "sarcos")
    path = real.find(logs)
    if path is None:
        raise UsageError(
            "SARCOS is not there", where=str(logs), next_step=f"Put {' or '.join(real.files)} there."
        )
    data, rows = real.load(path), list[Row]()
    for count in COUNTS:
        errors, seconds = zip(*_errors(data, count), strict=True)
        first = rows[0].value if rows else None
        rows.append(Row(f"nmse_{count}", float(np.mean(errors)), "1", f"{COUNTS[0]}", first))
        rows.append(Row(f"cpu_{count}", float(np.mean(seconds)), "s"))
    return rows


def _errors(data: Recording, count: int) -> Iterator[tuple[float, float]]:
    """nMSE and CPU seconds of each fold."""
    commands = data.train.command.shape[1]
    config = replace(data.world.config.model, fit_points=-(-count * USUAL_COMMANDS // commands))
    for train, test in folds(data.train):
        began = time.process_time()
        model = data.world.learned(train, config, np.random.default_rng(0), body=False).model
        seconds = time.process_time() - began
        scores = figures(test.command, model.mean(test.log), None, test.usable & test.moving)
        yield float(scores.nmse.mean()), seconds


def folds(samples: Samples) -> Iterator[tuple[Samples, Samples]]:
    """What teaches and what is left out, every fourth block in turn."""
    block = np.argsort(np.argsort(samples.t, kind="stable")) * BLOCKS // len(samples)
    for remainder in range(EVERY):
        out = block % EVERY == remainder
        yield samples.take(~out), samples.take(out)


if __name__ == "__main__":
    table(fit_rows(Path(sys.argv[1]) if len(sys.argv) > 1 else Path()), "SARCOS, training blocks left out")
