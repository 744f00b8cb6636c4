"""A flight at the rate of its model: means over each sample interval, so that noise does not fold in."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from etude.logs.derivatives import median_rate
from etude.logs.flight.log import FlightLog
from etude.trajectories.flight.states import FlightStates

Array = NDArray[np.float64]


def sampled_flight(log: FlightLog, rate: float, *, averaged: bool = True) -> FlightLog:
    """The flight at `rate` Hz or a little above; as it is if its own rate is no higher.

    Args:
        log: on a uniform grid.
        rate: Hz.
        averaged: means over the interval, at its middle; else single samples at its start (thesis).
    """
    ticks = int(median_rate(log.t) / rate + 1e-6)
    count = len(log) // max(ticks, 1)
    if ticks < 2 or count == 0:
        return log

    def take(values: Array | None) -> Array | None:
        if values is None:
            return None
        if not averaged:
            return values[: count * ticks : ticks]
        return np.asarray(values[: count * ticks].reshape(count, ticks, *values.shape[1:]).mean(axis=1))

    states = {field.name: take(getattr(log.states, field.name)) for field in fields(FlightStates)}
    moved = {name: take(getattr(log, name)) for name in ("t", "command", "position", "position_des")}
    return replace(log, states=FlightStates(**states), **moved)  # type: ignore[arg-type]
