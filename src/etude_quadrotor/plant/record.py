"""From a flight to the log that a model learns from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError, UsageError
from etude.types import Channel, Log
from etude_quadrotor.channels import (
    ALTITUDE,
    ANGULAR_ACCELERATION,
    BODY_ACCELERATION,
    BODY_VELOCITY,
    POSITION,
    POSITION_DES,
    RATES,
    SPECIFIC_FORCE,
)
from etude_quadrotor.plant.flight import Flight
from etude_quadrotor.plant.plan import FlightPlan

Array = NDArray[np.float64]


def flight_log(flight: Flight, plan: FlightPlan, rate: float = 10.0, averaged: bool = True) -> Log:
    """The flight at `rate` Hz, without what was not flown.

    Args:
        plan: that was flown.
        rate: Hz, a divisor of the simulation's rate.
        averaged: means over each sample interval, as an anti-aliasing filter gives them, each at the middle
            of its interval; else single samples at the interval's start (the thesis).

    Raises:
        UsageError: a rate that does not divide the simulation's, or another plan.
        DataError: a flight shorter than one sample, or one with a command at its limit in every sample.
    """
    ticks = _ticks(flight, plan, rate)
    count = len(flight) // ticks
    if count == 0 or flight.saturated.all():
        what = "is shorter than one sample" if count == 0 else "stood at a command's limit all the time"
        raise DataError(
            f"the flight {what}",
            where=f"{flight.source}{f': {flight.ended}' if flight.ended else ''}",
            next_step="Fly a gentler or longer trajectory, or check the feedforward.",
        )

    def sampled(rows: Array) -> Array:
        if not averaged:
            return rows[: count * ticks : ticks]
        return np.asarray(rows[: count * ticks].reshape(count, ticks, *rows.shape[1:]).mean(axis=1))

    log = Log(sampled(flight.t), {}, {}, flight.source)
    for channel, rows in _columns(flight, plan):
        log = log.put(channel, sampled(rows))
    return log if flight.ended is None else log.repaired(f"The flight was cut: {flight.ended}.")


def _columns(flight: Flight, plan: FlightPlan) -> tuple[tuple[Channel, Array], ...]:
    """Channels and their values at every tick of the flight or of the plan."""
    command = Channel("command", flight.command_names, (flight.command_unit,) * 4, "command", required=True)
    return (
        (ALTITUDE, flight.position[:, 2:]),
        (SPECIFIC_FORCE, flight.specific_force),
        (RATES, flight.rates),
        (ANGULAR_ACCELERATION, flight.angular_acceleration),
        (BODY_VELOCITY, flight.velocity_body),
        (BODY_ACCELERATION, flight.acceleration_body),
        (command, flight.command),
        (POSITION, flight.position),
        (POSITION_DES, plan.position),
    )


def _ticks(flight: Flight, plan: FlightPlan, rate: float) -> int:
    """Ticks of the simulation per sample."""
    if len(plan) < len(flight) or plan.t[0] != flight.t[0]:
        raise UsageError(
            "the plan is not the one that was flown",
            where=flight.source,
            next_step="Give the plan that the flight was made from.",
        )
    own = (len(plan) - 1) / float(plan.t[-1] - plan.t[0]) if len(plan) > 1 else rate
    ticks = own / rate if np.isfinite(rate) and rate > 0.0 else 0.0
    if ticks < 1.0 - 1e-6 or abs(ticks - round(ticks)) > 1e-6 * ticks:
        raise UsageError(
            f"a log at {rate:g} Hz cannot be taken from a simulation at {own:g} Hz",
            where="rate",
            next_step="Choose a divisor of the simulation's rate.",
        )
    return round(ticks)
