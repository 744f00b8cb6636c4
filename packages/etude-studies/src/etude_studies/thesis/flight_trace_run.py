"""P2t: what figures 5.3 and 5.8 draw over time, of one seed of the Pelican's designed flights."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import polars as pl

from etude.types import Array
from etude_studies.measured import Measured
from etude_studies.thesis.flights import flight_traces

PATH, LEARNED, PART = 2, 5, "thrust"
"""The flight that is drawn, the first an arm chooses; flights learned before the command is; the command."""
AXES = ("x", "y", "z")


def run(_: Mapping[str, Any], seed: int, __: Mapping[str, pl.DataFrame]) -> list[Measured]:
    """k counts instants; test "after 2" has the path, "desired" and "flown" of parts x, y and z, m; test
    "after 5" the thrust command on a flight not learned, "actual", "mean" and "deviation"; both have "t", s.
    """
    recorded = flight_traces(seed=seed, flights=LEARNED, part=PART)
    path, command = f"after {PATH}", f"after {LEARNED}"
    rows = [*_rows(path, "mean", "t", recorded["t_path"]), *_rows(command, "mean", "t", recorded["t"])]
    for name in ("desired", "flown"):
        for axis, values in zip(AXES, recorded[name].T, strict=True):
            rows += _rows(path, axis, name, values)
    for name in ("actual", "mean", "deviation"):
        rows += _rows(command, PART, name, recorded[name])
    return rows


def _rows(test: str, part: str, measure: str, values: Array) -> Iterator[Measured]:
    for k, value in enumerate(np.asarray(values, dtype=float).tolist()):
        yield Measured(k, test, "", part, measure, value)
