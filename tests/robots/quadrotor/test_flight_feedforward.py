"""Feedforward of flights: each part does in the loop what it is for, and gates hold."""

from dataclasses import replace

import numpy as np
import pytest
from etude.control.flight_feedforward import (
    LARGEST_CORRECTION,
    PID_ALONE,
    FlightFeedforward,
    GatedVoltages,
    LinearDrag,
    flight_plan,
    thrust_voltage,
)
from etude.models.physics.flight_inverse import nominal_inverse
from etude.robots.toml_file import load_robot
from etude.trajectories.flight.family import FlightFamily
from etude.trajectories.flight.feasible import feasible_flights
from etude.trajectories.flight.flatness import flat_motion
from etude.trajectories.flight.motion import motion_of
from etude.trajectories.flight.samplers import uniform_parameters

from etude.errors import NumericalError
from etude.robots.quadrotor.plant.registry import simulated_vehicle
from etude.robots.quadrotor.vehicle import GRAVITY

PLANT = simulated_vehicle("quadrotor")
FAMILY = FlightFamily(duration=30.0, start="moving")
NOMINAL = nominal_inverse(PLANT.vehicle)
EXACT = LinearDrag(tuple(PLANT.parameters.drag_per_mass))


@pytest.fixture(scope="module")
def trajectories():
    feasible = feasible_flights(load_robot("quadrotor").flight, FAMILY)
    return [FAMILY.trajectory(p) for p in uniform_parameters(np.random.default_rng(8), feasible, 3)]


def error(trajectory, feedforward):
    """Mean distance after 5 s in calm air, m, and mean |z| error."""
    plan = flight_plan(trajectory, feedforward, PLANT.vehicle, PLANT.rate)
    flight = PLANT.fly(plan, None, start="moving")
    assert flight.ended is None
    away = (flight.position - plan.position)[5000:]
    return np.linalg.norm(away, axis=1).mean(), np.abs(away[:, 2]).mean()


def test_each_part_helps_on_every_flight(trajectories):
    for trajectory in trajectories:
        pid, _ = error(trajectory, PID_ALONE)
        accelerated, _ = error(trajectory, FlightFeedforward())
        leaning, _ = error(trajectory, FlightFeedforward(drag=EXACT))
        planned, _ = error(trajectory, FlightFeedforward(drag=EXACT, voltages=NOMINAL))
        assert accelerated < pid
        assert leaning < 0.25 * accelerated
        assert planned < 1.01 * leaning


def test_hovering_needs_no_feedforward():
    still = FAMILY.trajectory(FAMILY.parameters(np.vstack([[0.0, 0.0, 2.0], np.zeros((4, 3))])))
    plan = flight_plan(still, FlightFeedforward(drag=EXACT, voltages=NOMINAL), PLANT.vehicle, PLANT.rate)
    np.testing.assert_allclose(plan.acceleration_ff, 0.0, atol=1e-12)
    np.testing.assert_allclose(plan.voltage_ff, 0.0, atol=1e-9)
    assert thrust_voltage(PLANT.vehicle, np.array([GRAVITY])) == pytest.approx(PLANT.vehicle.hover_voltage)


def test_the_lean_balances_the_drag(trajectories):
    """With drag d v the plan's acceleration is a + R D R' v: what flatness with that drag demands."""
    motion = motion_of(trajectories[0], np.linspace(0.0, 30.0, 40))
    flat = flat_motion(motion, EXACT.coefficients)
    R, d = flat.R_world_body, np.array(EXACT.coefficients)
    force = np.einsum("tij,j,tkj,tk->ti", R, d, R, motion.velocity)
    plan = flight_plan(trajectories[0], FlightFeedforward(drag=EXACT), PLANT.vehicle, PLANT.rate)
    found = np.stack([np.interp(motion.t, plan.t, column) for column in plan.acceleration_ff.T], axis=1)
    np.testing.assert_allclose(found, motion.acceleration + force, atol=2e-4)


class Guess:
    """A model that is wrong by 3 V, with a stated deviation."""

    prior_deviation = np.full(4, 0.2)
    calibrated = True

    def __init__(self, deviation):
        self.deviation = deviation

    def predict(self, states):
        return NOMINAL.predict(states) + 3.0, np.full((len(states), 4), self.deviation**2)


def test_a_wild_model_is_clipped_and_an_unsure_one_is_not_asked(trajectories):
    states = flat_motion(motion_of(trajectories[0], np.linspace(0.0, 30.0, 20))).states
    safe = NOMINAL.predict(states)
    sure = GatedVoltages(Guess(0.01), NOMINAL).predict(states)
    np.testing.assert_allclose(sure, safe + LARGEST_CORRECTION)
    unsure = GatedVoltages(Guess(0.2), NOMINAL).predict(states)
    np.testing.assert_allclose(unsure, safe)


def test_a_plan_that_is_not_finite_is_refused(trajectories):
    class Broken:
        def predict(self, states):
            return np.full((len(states), 4), np.nan)

    with pytest.raises(NumericalError, match="voltage is not finite"):
        flight_plan(trajectories[0], FlightFeedforward(voltages=Broken()), PLANT.vehicle, PLANT.rate)


def test_quiet_and_noisy_air_differ_little(trajectories):
    plan = flight_plan(trajectories[0], FlightFeedforward(drag=EXACT), PLANT.vehicle, PLANT.rate)
    quiet = PLANT.fly(plan, None, start="moving").position
    noisy = replace(PLANT, noise="low").fly(plan, np.random.default_rng(0), start="moving").position
    assert 0.0 < np.abs(quiet - noisy).max() < 0.1
