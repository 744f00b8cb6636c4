"""Rows of `etude bench models` on the real flights: measured by `crazyflie_flights`, named as the arms'."""

from __future__ import annotations

import numpy as np

from etude.types import Mask
from etude_studies.crazyflie_flights import (
    Outcome,
    by_block,
    by_manoeuvre,
    crazyflie_flights,
    in_flight,
)
from etude_studies.real_accuracy import accuracy_rows, say
from etude_studies.rows import Row


def crazyflie_accuracy_rows(rng: np.random.Generator) -> list[Row]:
    """`nmse_crazyflie` on held-out blocks, `nmse_crazyflie_unseen` on a whole flight, and the motors' lag."""
    flights = crazyflie_flights()
    if not flights:
        say("nmse_crazyflie left out: examples/crazyflie is incomplete; install etude again.")
        return []
    block, unseen = by_block(flights, rng), by_manoeuvre(flights, rng)
    return [
        *_rows("crazyflie", block, np.ones(len(block.group), dtype=np.bool_)),
        *_rows("crazyflie_unseen", unseen, in_flight(unseen)),
        Row("crazyflie_motor_lag_ms", 1e3 * block.lag, "ms"),
    ]


def _rows(name: str, outcome: Outcome, mask: Mask) -> list[Row]:
    command, mean, linear, raw = (
        part[mask] for part in (outcome.command, outcome.mean, outcome.linear, outcome.raw)
    )
    return accuracy_rows(name, command, mean, linear, np.ones(command.shape, dtype=np.bool_), raw)
