"""What a model and physics alone said of training samples whose segment they had not seen, kept with it.

Physics are fitted without the segment and the process is conditioned without it. The few hyperparameters of
the process, and which rung is used, were chosen with all segments.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from etude.errors import DataError
from etude.models.data.cross_validation import fold_mean
from etude.models.selection.model_selection import Ladder
from etude.models.store import DAMAGE
from etude.storage import arrays_of
from etude.types import Array, Index

PHYSICS = ("identified", "nominal", "linear")
"""Rungs that stand for physics alone, the first that a robot has."""
CONSTANT = "constant"
"""What stands for it where a model is no more than that: a command that does not depend on the motion."""


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Errors of n samples, NaN where a command was not predicted.

    Attributes:
        rows: (n,) places among the samples in order (`rows.in_order`).
        group: (n,) segment.
        error: (n, J) command less prediction, command units.
        variance: (n, J) predicted, noise and calibration included.
        physics: (n, J) error of physics alone; of a model that is no more than these, of what there was
            before: the model file's physics, else a constant command.
        rung: what stands for physics: one of `PHYSICS`, or `CONSTANT`.
    """

    rows: Index
    group: Index
    error: Array
    variance: Array
    physics: Array
    rung: str

    def to_bytes(self) -> bytes:
        """The file."""
        file = io.BytesIO()
        np.savez_compressed(file, **vars(self))
        return file.getvalue()


def left_out_of(ladder: Ladder) -> LeftOut:
    """Those samples of a training of which something was said."""
    found = ladder.left_out
    rung, physics = _before(ladder)
    rows = np.flatnonzero(np.isfinite(found.error).any(axis=1))
    own = found.error[rows], found.variance[rows]
    return LeftOut(rows, ladder.samples.group[rows], *own, physics[rows], rung)


def _before(ladder: Ladder) -> tuple[str, Array]:
    """What the choice is compared with, and its errors (n, J): a model is not held against itself."""
    first = next(name for name in PHYSICS if name in ladder.held_out)
    for rung in dict.fromkeys((first, "nominal")):
        held = ladder.held_out.get(rung)
        if held is not None and not np.array_equal(held.error, ladder.left_out.error, equal_nan=True):
            return rung, held.error
    command, fold, error = ladder.samples.command, ladder.left_out.fold, ladder.left_out.error
    known = np.where(np.isfinite(error), command, np.nan)
    left = np.full_like(known, np.nan)
    for number in np.unique(fold):
        own = fold == number
        means = [fold_mean(column) for column in known[~own].T]
        left[own] = known[own] - np.array(means)
    return CONSTANT, left


def read_left_out(path: Path) -> LeftOut:
    """What `LeftOut.to_bytes` wrote.

    Raises:
        DataError: no such file, or a damaged one.
    """
    try:
        found = arrays_of(path.read_bytes())
        return LeftOut(**{**found, "rung": str(found["rung"])})
    except DAMAGE as error:
        raise DataError(
            f"what was held out cannot be read ({error})",
            where=str(path),
            next_step="Learn the logs again: etude untell the newest one, then tell it.",
        ) from error
