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
from etude.models.selection.model_selection import Ladder
from etude.models.store import DAMAGE
from etude.storage import arrays_of
from etude.types import Array, Index

PHYSICS = ("identified", "nominal", "linear")
"""Rungs that stand for physics alone, the first that a robot has."""


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Errors of n samples, NaN where a command was not predicted.

    Attributes:
        rows: (n,) places among the samples in order (`rows.in_order`).
        group: (n,) segment.
        error: (n, J) command less prediction, command units.
        variance: (n, J) predicted, noise and calibration included.
        physics: (n, J) error of physics alone.
        rung: what stands for physics: one of `PHYSICS`.
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
    found, rung = ladder.left_out, next(name for name in PHYSICS if name in ladder.held_out)
    rows = np.flatnonzero(np.isfinite(found.error).any(axis=1))
    physics = ladder.held_out[rung].error[rows]
    return LeftOut(rows, ladder.samples.group[rows], found.error[rows], found.variance[rows], physics, rung)


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
