"""Robot seconds until a tracking error is reached, by every method, from the results of their runs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import polars as pl

from etude_studies.measured import Measured
from etude_studies.spec import Spec
from etude_studies.thesis.arm_runs import ARM_RUNS, arm_spec

METHODS = ("A1", "A7", "S1", "S9", "DP1", "DP2", "DP3", "DP4")
LINES = ("linear", "identified", "identified_measured")
"""Beside A1."""
THRESHOLDS_DEG = (0.5, 0.3, 0.2, 0.1)
MOTION_S = 60.0
TESTS = ("fourier", "moves")


def reach_spec(seed: int) -> Spec:
    """Of a seed; it needs the runs of all methods."""
    needs = [arm_spec(ARM_RUNS[name][1], seed) for name in METHODS]
    return Spec("etude_studies.thesis.reach_runs:run", {"methods": list(METHODS)}, seed, needs)


def run(settings: Mapping[str, Any], _: int, needs: Mapping[str, pl.DataFrame]) -> list[Measured]:
    """R1: seconds of training motion after which the test's error is at most a threshold and stays so; NaN
    where it is not reached. The model is the method, the part the threshold, deg.
    """
    rows = []
    for name, table in zip(settings["methods"], needs.values(), strict=True):
        sources = {name: "", **({line: line for line in LINES} if name == "A1" else {})}
        for source, model in sources.items():
            for test in TESTS:
                errors = _errors(table, model, test)
                for threshold in THRESHOLDS_DEG if errors else ():
                    seconds = seconds_until(errors, threshold)
                    rows.append(Measured(0, test, source, f"{threshold:g}", "seconds_until", seconds))
    return rows


def seconds_until(errors: Mapping[int, float], threshold: float) -> float:
    """The least number of motions from which on the errors by k are at most the threshold, in seconds."""
    above = [k for k, error in errors.items() if not error <= threshold]
    reached = [k for k in errors if k > max(above, default=0)]
    return MOTION_S * min(reached) if reached else math.nan


def _errors(table: pl.DataFrame, model: str, test: str) -> dict[int, float]:
    keys = {"measure": "error", "part": "mean", "model": model, "test": test}
    errors = table.filter(*(pl.col(name) == value for name, value in keys.items()))
    return dict(zip(errors["k"].to_list(), errors["value"].to_list(), strict=True))
