"""The physics of the inverse: closed-form round trip, derivatives, identification, missing columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from inverse_flights import TRUTH, VEHICLE, flights, random_states, voltages

from etude.errors import DataError
from etude.models.physics.flight_inverse import (
    COEFFICIENTS,
    VehicleInverse,
    analytic_command,
    identify_vehicle,
    nominal_inverse,
    unreachable,
)
from etude.models.physics.flight_linear import identify_linear
from etude.robots.vehicle import GRAVITY
from etude.trajectories.flight.states import FlightStates


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31))
def test_the_inverse_undoes_thrust_and_moments_of_given_rotor_speeds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    W = rng.uniform(100.0, 600.0, (20, 4))
    omega = rng.uniform(-3.0, 3.0, (20, 3))
    load = W**2 @ VEHICLE.allocation().T
    J = np.diag(VEHICLE.inertia)
    moments = load[:, 1:] - np.cross(omega, omega @ J)
    alpha = moments / np.array(VEHICLE.inertia)
    force = np.column_stack([rng.normal(size=(20, 2)), load[:, 0] / VEHICLE.mass])
    states = FlightStates(None, force, omega, alpha)
    expected = VEHICLE.steady_voltage(W)
    np.testing.assert_allclose(analytic_command(VEHICLE, states), expected, rtol=0, atol=1e-10)
    assert not unreachable(VEHICLE, states).any()


def test_hover_needs_the_hover_voltage() -> None:
    still = np.zeros((1, 3))
    states = FlightStates(None, np.array([[0.0, 0.0, GRAVITY]]), still, still)
    np.testing.assert_allclose(analytic_command(VEHICLE, states), VEHICLE.hover_voltage, rtol=1e-12)


def test_a_rotor_that_would_have_to_pull_gets_nothing_and_is_told() -> None:
    still = np.zeros((2, 3))
    alpha = np.array([[300.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    states = FlightStates(None, np.tile([0.0, 0.0, GRAVITY], (2, 1)), still, alpha)
    assert unreachable(VEHICLE, states).tolist() == [True, False]
    command = analytic_command(VEHICLE, states)
    assert (command >= 0.0).all()
    assert np.count_nonzero(command[0] == 0.0) == 2
    assert np.isfinite(VehicleInverse(VEHICLE, TRUTH).linearised(states)[1]).all()


def test_signs_of_the_corrections() -> None:
    """Near the ground less voltage, climbing against drag more, a stronger motor constant more."""
    still, up = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]])
    low = FlightStates(np.array([0.1]), np.array([[0.0, 0.0, GRAVITY]]), still, still, up)
    nominal = nominal_inverse(VEHICLE).predict(low)
    for name, sign in {
        "ground_near": -1.0,
        "ground_far": -1.0,
        "drag_vertical": 1.0,
        "back_emf": 1.0,
    }.items():
        theta = 0.1 * (np.array(COEFFICIENTS) == name)
        assert (sign * (VehicleInverse(VEHICLE, theta).predict(low) - nominal) > 1e-3).all(), name
    # drag above the centre, flying forward, turns the nose up (-y): front rotors weaker, rear ones stronger
    forward = replace(low, velocity=np.array([[1.0, 0.0, 0.0]]))
    theta = 0.01 * (np.array(COEFFICIENTS) == "drag_lateral")
    change = VehicleInverse(VEHICLE, theta).predict(forward)[0] - nominal[0]
    x = VEHICLE.rotors[:, 0]
    assert (change * x < 0.0).all()


def test_the_derivative_is_that_of_differences() -> None:
    states = random_states(np.random.default_rng(1), seconds=2.0)
    _, jacobian = VehicleInverse(VEHICLE, TRUTH).linearised(states)
    for i in range(len(COEFFICIENTS)):
        step = 1e-6 * np.eye(len(COEFFICIENTS))[i]
        ends = [VehicleInverse(VEHICLE, TRUTH + s * step).predict(states) for s in (1, -1)]
        np.testing.assert_allclose(jacobian[:, :, i], (ends[0] - ends[1]) / 2e-6, rtol=1e-5, atol=1e-7)


def test_identification_finds_the_coefficients_again() -> None:
    data = flights(2, noise=0.0)
    found = identify_vehicle(VEHICLE, data.states, data.command).coefficients
    np.testing.assert_allclose(found, TRUTH, rtol=1e-5, atol=1e-8)


def test_without_trims_the_motors_are_alike() -> None:
    data = flights(2, noise=0.0)
    found = identify_vehicle(VEHICLE, data.states, data.command, trims=False)
    np.testing.assert_array_equal(found.coefficients[9:], 0.0)
    assert 0.02 < np.abs(found.predict(data.states) - data.command).mean() < 0.05


def test_identification_survives_noise_and_predicts_another_flight() -> None:
    data = flights(2, noise=0.02)
    model = identify_vehicle(VEHICLE, data.states, data.command)
    told_apart = np.array([not name.startswith(("back", "trim")) for name in COEFFICIENTS])
    assert np.abs(model.coefficients - TRUTH)[told_apart].max() < 0.05
    fresh = random_states(np.random.default_rng(9))
    error = np.abs(model.predict(fresh) - voltages(fresh)).mean()
    assert error < 0.004 < 0.05 < np.abs(analytic_command(VEHICLE, fresh) - voltages(fresh)).mean()


def test_terms_of_missing_quantities_drop_out() -> None:
    data = flights(1)
    bare = replace(data.states, altitude=None, velocity=None)
    model = identify_vehicle(VEHICLE, bare, data.command)
    np.testing.assert_array_equal(model.coefficients[:4], 0.0)
    full = VehicleInverse(VEHICLE, TRUTH)
    kept = VehicleInverse(VEHICLE, np.where(np.arange(13) < 4, 0.0, TRUTH))
    np.testing.assert_array_equal(full.predict(bare), kept.predict(bare))


def test_gains_shrink_what_noisy_accelerations_say() -> None:
    data = flights(2)
    rng = np.random.default_rng(3)
    alpha = data.states.angular_acceleration
    noisy = replace(data.states, angular_acceleration=alpha + 10.0 * rng.normal(size=alpha.shape))
    gains = identify_vehicle(VEHICLE, noisy, data.command).coefficients[6:9]
    assert (gains < -0.9).all()


@pytest.mark.parametrize("identify", [lambda s, c: identify_vehicle(VEHICLE, s, c), identify_linear])
def test_nan_and_nothing_are_refused(identify) -> None:
    data = flights(1)
    broken = data.command.copy()
    broken[3, 1] = np.nan
    with pytest.raises(DataError, match="NaN"):
        identify(data.states, broken)
    with pytest.raises(DataError, match="no sample"):
        identify(data.states.take(slice(0, 0)), data.command[:0])


def test_the_linear_map_predicts_a_vehicle_that_nobody_described() -> None:
    data = flights(3)
    setpoint = 0.1 * data.command + 0.2  # normalised set-points of unknown motors
    model = identify_linear(data.states, setpoint)
    fresh = random_states(np.random.default_rng(9))
    wanted = 0.1 * voltages(fresh) + 0.2
    error = np.mean((model.predict(fresh) - wanted) ** 2) / wanted.var()
    assert error < 0.02
    assert model.uses == ("altitude", "velocity", "acceleration")
    with pytest.raises(DataError, match="velocity"):
        model.predict(replace(fresh, velocity=None))


def test_the_linear_map_ignores_a_column_that_never_changed() -> None:
    data = flights(1)
    still = replace(data.states, altitude=np.full(len(data), 1.5))
    model = identify_linear(still, data.command)
    here, high = model.predict(still), model.predict(replace(still, altitude=np.full(len(data), 40.0)))
    np.testing.assert_array_equal(here, high)
