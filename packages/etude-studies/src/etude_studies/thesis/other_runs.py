"""Runs for chapter 7 from studies of the loop: online learning on the arm, a process in a quadrotor's
loop.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl

from etude_studies import flight_loop, online
from etude_studies.measured import Measured

ROBOT = "arm4"
RULES = ("none", "variance", "error")
LEARNED_FROM = 4
VARIANTS = ("pid", "acceleration", "gp_voltage_only", "learned")


def on_line(_: Mapping[str, Any], seed: int, __: Mapping[str, pl.DataFrame]) -> list[Measured]:
    """O1: three passes of a motion; k is the pass, the test what happens to the arm after the first, the
    model the rule by which it goes on learning; tracking error, deg (thesis 6.4, 7.1.4).
    """
    rows = []
    for change in online.CHANGES:
        cell = online.Cell(ROBOT, change, seed)
        configs = online.PLACES[ROBOT, change]
        rules = {
            name: config for name, config in configs.items() if name in RULES or name.endswith("forgetting")
        }
        for rule, outcome in online.outcomes_of(cell, rules).items():
            for k, errors in enumerate(outcome.errors, start=1):
                rows.append(Measured(k, change, rule, "mean", "error", float(np.mean(errors))))
    return rows


def in_the_loop(_: Mapping[str, Any], seed: int, __: Mapping[str, pl.DataFrame]) -> list[Measured]:
    """L1: mean distance from the plan after the first 5 s, m, after four flights; the test is the air, the
    model what is added to PID (thesis 7.1.1).
    """
    cell = flight_loop.Cell("quadrotor", "moving", 2, seed)
    errors = flight_loop.seed_errors(cell, learned_from=(LEARNED_FROM,))
    rows = []
    for variant, error in errors.items():
        name, air = variant.split("/")
        name = name.removesuffix(f"_{LEARNED_FROM}")
        if name in VARIANTS:
            rows.append(Measured(LEARNED_FROM, air, name, "mean", "position", error))
    return rows
