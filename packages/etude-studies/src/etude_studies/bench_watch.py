"""`etude bench watch --logs FOLDER`: the test of a changed robot on the flights of CrazyPAD.

Of each machine the first half of its normal flights teaches; the other half, and every flight with a weight,
tape or a cut propeller, is judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from etude.errors import UsageError
from etude.models import ChangeTest, ModelConfig, change_test, select_structures
from etude.types import joined_samples
from etude_studies.crazypad import MOTORS, NORMAL, Flight, Inputs, flights
from etude_studies.rows import Row, rows_json, table

MODEL = ModelConfig(kernel="ard_se", candidates=("default",), points=600)


def run(*, json: bool = False, seed: int = 0, logs: Path | None = None) -> list[Row]:
    """Judges all flights and prints the rows.

    Raises:
        UsageError: no folder, or the file is not in it.
    """
    if logs is None:
        raise UsageError("CrazyPAD is not part of the project", where="--logs", next_step="Name its folder.")
    every = flights(logs)
    tests_by_condition: dict[str, list[ChangeTest]] = {}
    for machine in dict.fromkeys(flight.machine for flight in every):
        for condition, one in of_machine([f for f in every if f.machine == machine], seed):
            tests_by_condition.setdefault(condition, []).append(one)
    rows = [row for condition, tests in tests_by_condition.items() for row in rows_of(condition, tests)]
    if json:
        print(rows_json(rows, "etude bench watch --logs FOLDER --json"))  # noqa: T201
    else:
        table(rows, "CrazyPAD: is it the machine that the model knows?")
    return rows


def of_machine(machine_flights: Sequence[Flight], seed: int) -> list[tuple[str, ChangeTest]]:
    """Condition and test of each flight that taught nothing."""
    normal = [f for f in machine_flights if f.condition == NORMAL]
    taught = normal[: (len(normal) + 1) // 2]
    if len(taught) < 2:
        return []
    samples = joined_samples([f.samples for f in taught])
    rng, limit = np.random.default_rng(seed), np.ones(len(MOTORS))
    model = select_structures(samples, Inputs(), {}, limit, MODEL, rng).model  # type: ignore[arg-type]
    return [(f.condition, change_test(model, f.samples)) for f in machine_flights if f not in taught]


def rows_of(condition: str, tests: Sequence[ChangeTest]) -> list[Row]:
    """How many flights alarm, and how large their errors are."""
    alarms = sum(one.alarm is not None for one in tests)
    return [
        Row(f"alarms_{condition}", alarms, "1", f"of {len(tests)} flights"),
        Row(f"z2_{condition}", float(np.median([one.z2 for one in tests])), "1", "median"),
    ]
