"""Closes a flying campaign's loop with its simulated vehicle, and tests the controller after every flight."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from etude.campaign.abandon import abandon
from etude.campaign.ask import ask, stored_trajectory
from etude.campaign.flight.learner import load_chosen, told_flights
from etude.campaign.folder import Campaign
from etude.campaign.learner import Say
from etude.campaign.rounds import SimulatedRound, interrupted_round, known_evaluation, robot_seconds
from etude.campaign.tell import tell
from etude.control.flight_feedforward import (
    PID_ALONE,
    FlightFeedforward,
    GatedVoltages,
    LinearDrag,
    flight_plan,
)
from etude.errors import DataError, UsageError
from etude.logs.flight.log import FlightLog
from etude.logs.flight.parquet import write_flight
from etude.models.flight.drag import train_drag
from etude.models.physics.flight_inverse import VehicleInverse, nominal_inverse
from etude.plants.flight.record import flight_log
from etude.plants.flight.registry import FLIGHT_PLANTS, flight_plant
from etude.plants.flight.simulated import SimulatedVehicle
from etude.trajectories.flight.family import FlightFamily
from etude.trajectories.flight.feasible import feasible_flights
from etude.trajectories.flight.samplers import boundary_parameters, uniform_parameters
from etude.trajectories.fourier import FourierTrajectory

Array = NDArray[np.float64]
RUN_STREAM, TEST_STREAM = 3, 4
SETTLED_S = 5.0
"""Tracking is judged after the transient of the start."""
TEST_HARMONICS = 2
MOST_TRIES = 4
"""Flights tried for each that is wanted."""


def simulate_flights(campaign: Campaign, rounds: int, say: Say) -> Iterator[SimulatedRound]:
    """Asks, flies and tells `rounds` flights under the vehicle's own PID, and evaluates after each one.

    A flight that breaks off before its middle is given up, and another one asked for.

    Raises:
        UsageError: the vehicle has no simulated plant.
        DataError: too many flights left their room.
    """
    plant = _plant(campaign)
    tests = test_flights(campaign)
    for name, feedforward in _baselines(plant).items():
        _evaluate(campaign, plant, tests, 0, feedforward, baseline=name)
    left = interrupted_round(campaign, say)
    if left is not None:  # or its tests would be missing from the curve
        yield _evaluate_round(campaign, plant, tests, left)
    flown = 0
    for _ in range(MOST_TRIES * rounds):
        if flown == rounds:
            return
        number = ask(campaign, go_on=True, say=say).number
        say(f"Flying trajectory {number} on the simulated {plant.name}.")
        rng = np.random.default_rng([campaign.state().seed, number, RUN_STREAM])
        log = _fly(campaign, plant, stored_trajectory(campaign, number), PID_ALONE, rng)
        path = campaign.path / "simulated" / f"{number:04d}.parquet"
        write_flight(log, path)
        try:
            tell(campaign, path, number=number, say=say)
        except DataError as refused:  # it broke off: what a pilot would give up too
            say(f"Flight {number} is given up: {refused.fact}.")
            abandon(campaign, number)
            continue
        flown += 1
        yield _evaluate_round(campaign, plant, tests, number)
    if flown < rounds:
        raise DataError(
            f"only {flown} of {rounds} flights kept inside the room",
            where=str(campaign.path),
            next_step="Lower the speed or widen the margin in robot.toml: the controller cannot keep it.",
        )


def test_flights(campaign: Campaign) -> dict[str, FourierTrajectory]:
    """The campaign's test flights by name, fixed by its seed and never trained on.

    Uniform on the feasible set of the thesis's form (N = 2), and on its edge.
    """
    flight, spec = campaign.config.flight, campaign.spec.flight
    assert flight is not None
    assert spec is not None
    rng = np.random.default_rng([campaign.state().seed, TEST_STREAM])
    family = FlightFamily(TEST_HARMONICS, flight.trajectory.duration, start=flight.trajectory.start)
    feasible = feasible_flights(spec, family)
    drawn = {"uniform": uniform_parameters(rng, feasible), "boundary": boundary_parameters(rng, feasible)}
    return {name: family.trajectory(parameters[0]) for name, parameters in drawn.items()}


def position_error(log: FlightLog, duration: float) -> Array:
    """Mean |desired - actual| in m after the start's transient: along x, y, z, and the distance, (4,).

    A flight that ended early goes on with its last error to the plan's `duration` in s.
    """
    assert log.position is not None
    assert log.position_des is not None
    error = log.position_des - log.position
    step = (log.t[-1] - log.t[0]) / (len(log) - 1)
    missing = max(0, round((duration - log.t[-1]) / step) - 1)
    t = np.append(log.t, log.t[-1] + step * np.arange(1, missing + 1))
    error = np.concatenate([error, np.repeat(error[-1:], missing, axis=0)])
    settled = error[t >= min(SETTLED_S, 0.5 * duration)]
    return np.append(np.abs(settled).mean(axis=0), np.linalg.norm(settled, axis=1).mean())


def _plant(campaign: Campaign) -> SimulatedVehicle:
    name = campaign.spec.plant
    if name is None or name not in FLIGHT_PLANTS:
        raise UsageError(
            f"vehicle '{campaign.spec.name}' has no simulated plant",
            where=str(campaign.path / "robot.toml"),
            next_step=f'Write plant = "..." with one of {", ".join(FLIGHT_PLANTS)}, or fly the real one.',
        )
    return flight_plant(name)


def _baselines(plant: SimulatedVehicle) -> dict[str, FlightFeedforward]:
    """What there is without learning, and the exact drag, which no model can know better."""
    exact = plant.parameters.drag_per_mass
    nominal = _nominal(plant)
    return {
        "pid": PID_ALONE,
        "analytic": FlightFeedforward(voltages=nominal),
        "exact_drag": FlightFeedforward(drag=LinearDrag((exact[0], exact[1], exact[2])), voltages=nominal),
    }


def _fly(
    campaign: Campaign,
    plant: SimulatedVehicle,
    trajectory: FourierTrajectory,
    feedforward: FlightFeedforward,
    rng: np.random.Generator,
    *,
    walls: bool = True,
) -> FlightLog:
    """The flight's log; with `walls` it ends where the vehicle leaves its room."""
    flight, spec = campaign.config.flight, campaign.spec.flight
    assert flight is not None
    assert spec is not None
    plan = flight_plan(trajectory, feedforward, plant.vehicle, plant.rate)
    flown = plant.fly(plan, rng, start=flight.trajectory.start, room=spec if walls else None)
    return flight_log(flown, plan, spec.rate, flight.data.averaged)


def _learned(campaign: Campaign, plant: SimulatedVehicle, number: int) -> FlightFeedforward:
    """Acceleration, learned drag, and the chosen model's voltages, gated."""
    model = load_chosen(campaign.model_folder(number))
    logs = [r.number for r in campaign.state().trained]
    drag = train_drag(told_flights(campaign, logs)[0])
    nominal = _nominal(plant)
    return FlightFeedforward(drag=drag, voltages=None if nominal is None else GatedVoltages(model, nominal))


def _nominal(plant: SimulatedVehicle) -> VehicleInverse | None:
    """The analytic voltages; None for a vehicle that is commanded by attitude and thrust."""
    return nominal_inverse(plant.vehicle) if plant.spec.command_unit == "V" else None


def _evaluate_round(
    campaign: Campaign, plant: SimulatedVehicle, tests: dict[str, FourierTrajectory], number: int
) -> SimulatedRound:
    errors = _evaluate(campaign, plant, tests, number, _learned(campaign, plant, number))
    return SimulatedRound(number, robot_seconds(campaign), errors, "m")


def _evaluate(
    campaign: Campaign,
    plant: SimulatedVehicle,
    tests: dict[str, FourierTrajectory],
    number: int,
    feedforward: FlightFeedforward,
    **facts: Any,
) -> dict[str, list[float]]:
    """Flies each test once, unless it was flown before; commits and returns the errors in m."""
    errors = {}
    for index, (name, trajectory) in enumerate(tests.items()):
        before = known_evaluation(campaign, name, number, facts.get("baseline"))
        if before is None:
            rng = np.random.default_rng([campaign.state().seed, index, TEST_STREAM, TEST_STREAM])
            log = _fly(campaign, plant, trajectory, feedforward, rng, walls=False)
            error = position_error(log, trajectory.duration).tolist()
            path = (
                campaign.path / "tests" / f"{number:04d}.{facts.get('baseline') or 'learned'}.{name}.parquet"
            )
            with campaign.writing():
                write_flight(log, path)
                measured = {**facts, "test": name, "robot_seconds": robot_seconds(campaign)}
                campaign.commit("evaluated", number, [path], **measured, tracking_error_m=error)
        else:
            error = before["tracking_error_m"]
        errors[name] = list(error)
    return errors
