"""Simulated vehicle as a robot: from a trajectory to a flight, and from the flight to a log."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec
import numpy as np

from etude.errors import DataError, UsageError
from etude.protocols import Controller, Trajectory
from etude.types import Array, Channel, Log
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
from etude_quadrotor.controller import flight_plan
from etude_quadrotor.motions import TEST_DURATION
from etude_quadrotor.plant.flight import Flight
from etude_quadrotor.plant.flight_plan import FlightPlan
from etude_quadrotor.plant.simulated_vehicle import (
    PLANTS,
    Disturbance,
    SimulatedVehicle,
    Start,
    simulated_vehicle,
)
from etude_quadrotor.spec import QuadrotorSpec

SETTLED_S = 5.0
"""Tracking is judged after the transient of the start."""
CHANGES = ("payload", "drag", "sag", "wind")


def flight_log(flight: Flight, plan: FlightPlan, rate: float = 10.0, averaged: bool = True) -> Log:
    """The log of the flight at `rate` Hz, up to its end.

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
        what = "is shorter than one sample" if count == 0 else "was at a command's limit all the time"
        raise DataError(
            f"the flight {what}",
            where=f"{flight.source}{f': {flight.ended}' if flight.ended else ''}",
            next_step="Fly a slower or longer trajectory, or check the feedforward.",
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
    plan_rate = (len(plan) - 1) / float(plan.t[-1] - plan.t[0]) if len(plan) > 1 else rate
    ticks = plan_rate / rate if np.isfinite(rate) and rate > 0.0 else 0.0
    # times of a plan are rounded: a millionth of a tick is a whole one
    if ticks < 1.0 - 1e-6 or abs(ticks - round(ticks)) > 1e-6 * ticks:
        raise UsageError(
            f"a log at {rate:g} Hz cannot be taken from a simulation at {plan_rate:g} Hz",
            where="rate",
            next_step="Choose a divisor of the simulation's rate.",
        )
    return round(ticks)


@dataclass(frozen=True, eq=False)
class SimulatedFlights:
    """Implements `protocols.Robot`.

    Attributes:
        vehicle: the truth, and its controller.
        spec: the owner's description: room and rate of the log.
        start: how flights begin.
        averaged: whether the log has means over its intervals, as an anti-aliasing filter gives them.
        duration: of test flights, s; one that ended early goes on with its last error.
        air: disturbances that no model knows.
    """

    vehicle: SimulatedVehicle
    spec: QuadrotorSpec
    start: Start = "hover"
    averaged: bool = True
    duration: float = 30.0
    air: Disturbance = field(default_factory=Disturbance)

    def run(self, trajectory: Trajectory, controller: Controller | None, rng: np.random.Generator) -> Log:
        """The flight's log; it ends where the vehicle leaves its room.

        Raises:
            UnsafeTrajectoryError: the plan is singular. NumericalError: a planned feedforward is not finite.
            DataError: it ended before the first sample, or was at a command's limit all the time.
        """
        return self._flown(trajectory, controller, rng, self.spec)

    def test(self, trajectory: Trajectory, controller: Controller | None, rng: np.random.Generator) -> Log:
        """The log of a flight that goes on outside the room, to judge a controller by all of it."""
        return self._flown(trajectory, controller, rng, None)

    def _flown(
        self,
        trajectory: Trajectory,
        controller: Controller | None,
        rng: np.random.Generator,
        room: QuadrotorSpec | None,
    ) -> Log:
        plan = flight_plan(trajectory, controller, self.vehicle.vehicle, self.vehicle.rate)
        flown = self.vehicle.fly(plan, rng, start=self.start, disturbance=self.air, room=room)
        return flight_log(flown, plan, self.spec.rate, self.averaged)

    def error(self, log: Log) -> tuple[Array, tuple[str, ...]]:
        """Mean |desired - actual| after the start's transient: along x, y, z, and the distance, (4,) m."""
        error = log["position_des"] - log["position"]
        step = (log.t[-1] - log.t[0]) / max(len(log) - 1, 1)
        missing = max(0, round((self.duration - log.t[-1]) / step) - 1) if step > 0.0 else 0
        t = np.append(log.t, log.t[-1] + step * np.arange(1, missing + 1))
        error = np.concatenate([error, np.repeat(error[-1:], missing, axis=0)])
        settled = error[t >= min(SETTLED_S, 0.5 * self.duration)]
        distance = np.linalg.norm(settled, axis=1).mean()
        return np.append(np.abs(settled).mean(axis=0), distance), ("m",) * 4

    def changed(self, **what: float) -> SimulatedFlights:
        """The vehicle with a payload (kg, at its centre), its drag times a factor, a battery that has lost
        a share of its voltage (sag), or in wind along x (m/s).

        Raises:
            UsageError: another change, or an impossible one.
        """
        for name in what:
            if name not in CHANGES:
                raise UsageError(
                    f"a simulated vehicle cannot change its {name}", next_step=f"It has {', '.join(CHANGES)}."
                )
        parameters, air = self.vehicle.parameters, self.air
        if "payload" in what:
            mass = _not_negative("payload", what["payload"]) + parameters.payload.mass
            parameters = _replaced(parameters, "payload", mass=mass)
        if "drag" in what:
            factor = _not_negative("drag", what["drag"])
            drag = tuple(factor * d for d in parameters.air.drag)
            parameters = _replaced(parameters, "air", drag=drag, quadratic=factor * parameters.air.quadratic)
        if "sag" in what:
            air = replace(air, sag=what["sag"])
        if "wind" in what:
            air = replace(air, wind=(what["wind"], 0.0, 0.0))
        return replace(self, vehicle=replace(self.vehicle, parameters=parameters), air=air)


def simulated_robot(spec: QuadrotorSpec, config: Any) -> SimulatedFlights:
    """The simulated vehicle that `spec` names, with the campaign's tables.

    Raises:
        UsageError: there is no such simulated vehicle.
    """
    if spec.plant is None:
        raise UsageError(
            f"vehicle '{spec.name}' has no simulated plant",
            where="robot.toml",
            next_step=f'Write plant = "..." with one of {", ".join(PLANTS)}, or fly the real one.',
        )
    vehicle = simulated_vehicle(spec.plant, "robot.toml, plant")
    trajectory, data = config.trajectory, config.data
    return SimulatedFlights(vehicle, spec, trajectory.start, data.averaged, TEST_DURATION)


def _replaced(parameters: Any, table: str, **changes: Any) -> Any:
    """The parameters with changes in one of their tables."""
    part = msgspec.structs.replace(getattr(parameters, table), **changes)
    return msgspec.structs.replace(parameters, **{table: part})


def _not_negative(name: str, value: float) -> float:
    if not (math.isfinite(value) and value >= 0.0):
        raise UsageError(f"a {name} of {value} is not possible", next_step="Give 0 or more.")
    return value
