"""From a flight to the log that a model learns from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError, UsageError
from etude.logs.flight.log import FlightLog
from etude.plants.flight.flight import Flight
from etude.plants.flight.plan import FlightPlan
from etude.trajectories.flight.states import FlightStates

Array = NDArray[np.float64]


def flight_log(flight: Flight, plan: FlightPlan, rate: float = 10.0, averaged: bool = True) -> FlightLog:
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

    return FlightLog(
        t=sampled(flight.t),
        states=FlightStates(
            altitude=sampled(flight.position[:, 2]),
            specific_force=sampled(flight.specific_force),
            rates=sampled(flight.rates),
            angular_acceleration=sampled(flight.angular_acceleration),
            velocity=sampled(flight.velocity_body),
            acceleration=sampled(flight.acceleration_body),
        ),
        command=sampled(flight.command),
        command_names=flight.command_names,
        command_unit=flight.command_unit,
        position=sampled(flight.position),
        position_des=sampled(plan.position),
        source=flight.source,
        repairs=() if flight.ended is None else (f"The flight was cut: {flight.ended}.",),
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
