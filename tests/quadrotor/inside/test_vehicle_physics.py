"""The physics of the inverse: closed-form round trip, derivatives, identification, missing channels."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from inverse_flights import SPEC, TRUTH, VEHICLE, flights, log_with, random_log, samples_of, voltages

from etude.errors import DataError
from etude.types import Samples
from etude_quadrotor import nominal_inverse
from etude_quadrotor.physics.flight_physics import Identified, Nominal
from etude_quadrotor.physics.linear_inverse import LinearInverse, identify_linear
from etude_quadrotor.physics.vehicle_inverse import (
    VehicleInverse,
    coefficient_names,
    identify_vehicle,
)
from etude_quadrotor.vehicle import GRAVITY

NOMINAL = nominal_inverse(VEHICLE)
COEFFICIENTS = coefficient_names(VEHICLE)
WEIGHT = np.array([0.0, 0.0, GRAVITY])


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
    log = log_with(np.arange(20.0), specific_force=force, rates=omega, angular_acceleration=alpha)
    np.testing.assert_allclose(NOMINAL.predict(log), VEHICLE.steady_voltage(W), rtol=0, atol=1e-10)


def resting(count: int = 1, **states: np.ndarray):
    """`count` instants of hover, with some states replaced."""
    still = np.zeros((count, 3))
    hover = {"specific_force": np.tile(WEIGHT, (count, 1)), "rates": still, "angular_acceleration": still}
    return log_with(np.arange(float(count)), **{**hover, **states})


def test_hover_needs_the_hover_voltage() -> None:
    np.testing.assert_allclose(NOMINAL.predict(resting()), VEHICLE.hover_voltage, rtol=1e-12)


def test_a_rotor_that_would_have_to_pull_gets_nothing() -> None:
    log = resting(2, angular_acceleration=np.array([[300.0, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    command = NOMINAL.predict(log)
    assert (command >= 0.0).all()
    assert np.count_nonzero(command[0] == 0.0) == 2
    assert np.isfinite(VehicleInverse(VEHICLE, TRUTH).linearised(log)[1]).all()


def test_signs_of_the_corrections() -> None:
    """Near the ground less voltage, climbing against drag more, a stronger motor constant more."""
    low = resting(altitude=np.array([0.1]), body_velocity=np.array([[0.0, 0.0, 1.0]]))
    nominal = NOMINAL.predict(low)
    for name, sign in {
        "ground_near": -1.0,
        "ground_far": -1.0,
        "drag_vertical": 1.0,
        "back_emf": 1.0,
    }.items():
        theta = 0.1 * (np.array(COEFFICIENTS) == name)
        assert (sign * (VehicleInverse(VEHICLE, theta).predict(low) - nominal) > 1e-3).all(), name
    # drag above the centre, flying forward, turns the nose up (-y): front rotors weaker, rear ones stronger
    forward = resting(altitude=np.array([0.1]), body_velocity=np.array([[1.0, 0.0, 0.0]]))
    theta = 0.01 * (np.array(COEFFICIENTS) == "drag_lateral")
    change = VehicleInverse(VEHICLE, theta).predict(forward)[0] - nominal[0]
    assert (change * VEHICLE.rotors[:, 0] < 0.0).all()


def test_the_derivative_is_that_of_differences() -> None:
    states = random_log(np.random.default_rng(1), seconds=2.0)
    _, jacobian = VehicleInverse(VEHICLE, TRUTH).linearised(states)
    for i in range(len(COEFFICIENTS)):
        step = 1e-6 * np.eye(len(COEFFICIENTS))[i]
        ends = [VehicleInverse(VEHICLE, TRUTH + s * step).predict(states) for s in (1, -1)]
        np.testing.assert_allclose(jacobian[:, :, i], (ends[0] - ends[1]) / 2e-6, rtol=1e-5, atol=1e-7)


def test_identification_finds_the_coefficients_again() -> None:
    data = flights(2, noise=0.0)
    found = identify_vehicle(VEHICLE, data.log).coefficients
    np.testing.assert_allclose(found, TRUTH, rtol=1e-5, atol=1e-8)


def test_without_trims_the_motors_are_alike() -> None:
    data = flights(2, noise=0.0)
    found = identify_vehicle(VEHICLE, data.log, trims=False)
    np.testing.assert_array_equal(found.coefficients[9:], 0.0)
    assert 0.02 < np.abs(found.predict(data.log) - data.command).mean() < 0.05


def test_identification_survives_noise_and_predicts_another_flight() -> None:
    data = flights(2, noise=0.02)
    model = identify_vehicle(VEHICLE, data.log)
    told_apart = np.array([not name.startswith(("back", "trim")) for name in COEFFICIENTS])
    assert np.abs(model.coefficients - TRUTH)[told_apart].max() < 0.05
    fresh = random_log(np.random.default_rng(9))
    error = np.abs(model.predict(fresh) - voltages(fresh)).mean()
    assert error < 0.004 < 0.05 < np.abs(NOMINAL.predict(fresh) - voltages(fresh)).mean()


def test_terms_of_missing_quantities_drop_out() -> None:
    bare = flights(1).log.without("altitude", "body_velocity")
    model = identify_vehicle(VEHICLE, bare)
    np.testing.assert_array_equal(model.coefficients[:4], 0.0)
    assert not any(np.isfinite(deviation) for _, deviation in list(model.parameters().values())[:4])
    full = VehicleInverse(VEHICLE, TRUTH)
    kept = VehicleInverse(VEHICLE, np.where(np.arange(13) < 4, 0.0, TRUTH))
    np.testing.assert_array_equal(full.predict(bare), kept.predict(bare))


def test_deviations_tell_how_far_coefficients_are_off() -> None:
    found = identify_vehicle(VEHICLE, flights(3, noise=0.02).log, 1.0).parameters()
    off = [(found[name][0] - true) / found[name][1] for name, true in zip(COEFFICIENTS, TRUTH, strict=True)]
    assert np.sqrt(np.mean(np.square(off[:4] + off[5:9]))) < 2.0
    assert nominal_inverse(VEHICLE).parameters() == {}


def test_gains_shrink_what_noisy_accelerations_say() -> None:
    log = flights(2).log
    rng = np.random.default_rng(3)
    alpha = log["angular_acceleration"]
    noisy = log.put(log.channels["angular_acceleration"], alpha + 10.0 * rng.normal(size=alpha.shape))
    gains = identify_vehicle(VEHICLE, noisy).coefficients[6:9]
    assert (gains < -0.9).all()


PHYSICS = {"vehicle": Identified(VEHICLE), "linear": Identified(None), "nominal": Nominal(VEHICLE)}


def commanded(samples: Samples, command: np.ndarray) -> Samples:
    return samples_of(samples.log.put(samples.log.channels["command"], command), samples.group)


@pytest.mark.parametrize("name", ["vehicle", "linear"])
def test_nan_and_nothing_are_refused(name: str) -> None:
    data = flights(1)
    broken = data.command.copy()
    broken[3, 1] = np.nan
    with pytest.raises(DataError, match="NaN"):
        PHYSICS[name](commanded(data, broken))
    for nothing in (None, data.take(slice(0, 0))):
        with pytest.raises(DataError, match="no sample"):
            PHYSICS[name](nothing)


@pytest.mark.parametrize("name", ["vehicle", "linear"])
def test_what_is_not_usable_says_nothing(name: str) -> None:
    data = flights(2)
    wild = data.command.copy()
    wild[::7, 2] += 5.0
    usable = data.usable.copy()
    usable[::7, 2] = False
    masked = Samples(commanded(data, wild).log, data.group, usable, usable)
    clean = Samples(data.log, data.group, usable, usable)
    fresh = random_log(np.random.default_rng(9))
    np.testing.assert_array_equal(PHYSICS[name](masked).predict(fresh), PHYSICS[name](clean).predict(fresh))


@pytest.mark.parametrize("name", list(PHYSICS))
def test_means_are_stored_and_stand_still(name: str) -> None:
    mean = PHYSICS[name](flights(2))
    fresh = random_log(np.random.default_rng(9))
    again = PHYSICS[name].restore(mean.arrays())
    np.testing.assert_array_equal(again.predict(fresh), mean.predict(fresh))
    assert again.parameters() == mean.parameters()
    one, other = (
        fresh,
        random_log(np.random.default_rng(10)).put(fresh.channels["altitude"], fresh["altitude"]),
    )
    np.testing.assert_allclose(mean.static(one), mean.static(other), rtol=1e-12)
    np.testing.assert_allclose(mean.static(one).mean(), VEHICLE.hover_voltage, rtol=0.1)


def test_the_linear_map_predicts_a_vehicle_that_nobody_described() -> None:
    data = flights(3)
    model = identify_linear(commanded(data, 0.1 * data.command + 0.2).log)  # set-points of unknown motors
    fresh = random_log(np.random.default_rng(9))
    wanted = 0.1 * voltages(fresh) + 0.2
    error = np.mean((model.predict(fresh) - wanted) ** 2) / wanted.var()
    assert error < 0.02
    assert model.uses == ("altitude", "body_velocity", "body_acceleration")
    with pytest.raises(DataError, match="body_velocity"):
        model.predict(fresh.without("body_velocity"))


def test_the_linear_map_ignores_a_column_that_never_changed() -> None:
    log = flights(1).log
    still = log.put(log.channels["altitude"], np.full((len(log), 1), 1.5))
    model = identify_linear(still)
    high = still.put(log.channels["altitude"], np.full((len(log), 1), 40.0))
    np.testing.assert_array_equal(model.predict(still), model.predict(high))
    assert isinstance(model, LinearInverse)
    assert SPEC.body == VEHICLE
