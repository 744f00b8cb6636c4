"""Laws that the simulated quadrotors obey, whatever their parameters."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import trapezoid

from etude_quadrotor.plant import core
from etude_quadrotor.plant.flight import Flight, rotation
from etude_quadrotor.plant.flight_plan import FlightPlan
from etude_quadrotor.plant.parameters import FlightParameters, load_flight_parameters
from etude_quadrotor.plant.simulated_vehicle import (
    NOWHERE,
    SimulatedVehicle,
    control,
    simulated_vehicle,
    true_body,
)

Array = NDArray[np.float64]
CLEAN = load_flight_parameters("quadrotor")
ROUGH = load_flight_parameters("quadrotor_rough")
SPINS = np.array([1.0, -1.0, 1.0, -1.0])
seeds = st.integers(0, 2**32 - 1)


def changed(p: FlightParameters, **air: Any) -> FlightParameters:
    return msgspec.structs.replace(p, air=msgspec.structs.replace(p.air, **air))


def random_state(seed: int) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    y = rng.normal(0.0, 2.0, 17)
    y[2] = rng.uniform(0.1, 5.0)
    y[6:10] /= np.linalg.norm(y[6:10])
    y[13:] = rng.uniform(50.0, 600.0, 4)
    return y, rng.uniform(0.0, 4.0, 4)


def derivative(y: Array, current: Array, body: core.Body) -> Array:
    out = np.empty(17)
    core.derivative(y, current, np.zeros(3), np.zeros(6), body, out)
    return out


def push(y: Array, current: Array, body: core.Body) -> tuple[Array, Array]:
    """Force without gravity and moment on the airframe without gyroscopic terms, both in the body frame."""
    out = derivative(y, current, body)
    spin = body.motors[:, 5] @ (SPINS * y[13:]) * np.array([0.0, 0.0, 1.0])
    free = np.linalg.inv(body.free_inverse)
    moment = free @ out[10:13] + np.cross(y[10:13], body.inertia @ y[10:13] + spin)
    lift = out[3:6] + np.array([0.0, 0.0, 9.81])
    return body.mass * rotation(y[None, 6:10])[0].T @ lift, moment


def energy(y: Array, body: core.Body) -> float:
    """Motion, height and spin; y (17,)."""
    v, w, W = y[3:6], y[10:13], y[13:]
    rotors = 0.5 * body.motors[:, 5] @ (W * (W + 2.0 * SPINS * w[2]))
    return float(body.mass * (0.5 * v @ v + 9.81 * y[2]) + 0.5 * w @ body.inertia @ w + rotors)


def test_hover_voltage_is_the_closed_form() -> None:
    vehicle = simulated_vehicle("quadrotor")
    t = np.arange(500) / 1000.0
    high = np.tile([0.0, 0.0, 500.0], (len(t), 1))
    flight = vehicle.fly(FlightPlan(t, high, np.zeros_like(high)), None)
    speed = math.sqrt(0.436 * 9.81 / (4.0 * 9.1e-6))
    volts = 0.6 * 1.8e-7 * speed**2 / 0.01466 + 0.01466 * speed
    np.testing.assert_allclose(flight.rotor_speed, speed, rtol=1e-7)
    np.testing.assert_allclose(flight.command, volts, rtol=1e-7)
    assert speed == pytest.approx(343.0, abs=0.5)
    assert volts == pytest.approx(5.89, abs=0.005)


@given(seed=seeds)
def test_rotors_push_and_turn_as_the_owners_allocation_says(seed: int) -> None:
    p = changed(CLEAN, drag=(0.0, 0.0, 0.0), ground_effect=False)
    body = true_body(p)
    y, _ = random_state(seed)
    steady = body.motors[:, 1] * y[13:] ** 2 / body.motors[:, 2]
    force, moment = push(y, steady, body)
    wrench = p.nominal.allocation() @ y[13:] ** 2
    np.testing.assert_allclose(force, [0.0, 0.0, wrench[0]], atol=1e-12)
    np.testing.assert_allclose(moment, wrench[1:], atol=1e-12)


@given(seed=seeds)
def test_power_is_balanced_at_every_instant(seed: int) -> None:
    """What the motors give and the air takes is the rate of energy; the stator's reaction is in it."""
    body = true_body(CLEAN)
    y, current = random_state(seed)
    rate = derivative(y, current, body)
    h = 1e-20j  # complex step: energy is a polynomial
    slope = (_energy_of(y + h * rate, body) / h).real
    v = rotation(y[None, 6:10])[0].T @ y[3:6]
    W, w = y[13:], y[10:13]
    climb = (v + np.cross(w, body.rotors))[:, 2]
    thrust = core.ground_effect(y[2], body.ground) * body.motors[:, 0] * W**2
    motors = (body.motors[:, 2] * current) @ W
    air = thrust @ climb - CLEAN.air.drag @ v**2 - (body.motors[:, 1] * W**2) @ (W + SPINS * w[2])
    assert slope == pytest.approx(motors + air, rel=1e-10, abs=1e-9)


def _energy_of(y: NDArray[np.complex128], body: core.Body) -> complex:
    v, w, W = y[3:6], y[10:13], y[13:]
    rotors = 0.5 * body.motors[:, 5] @ (W * (W + 2.0 * SPINS * w[2]))
    return complex(body.mass * (0.5 * v @ v + 9.81 * y[2]) + 0.5 * w @ body.inertia @ w + rotors)


def test_power_is_balanced_over_a_flight_to_the_order_of_the_integration() -> None:
    gaps = [_energy_gap(rate) for rate in (500.0, 1000.0, 2000.0)]
    assert gaps[1] < 2e-4
    assert gaps[0] / gaps[1] == pytest.approx(4.0, rel=0.3)
    assert gaps[1] / gaps[2] == pytest.approx(4.0, rel=0.3)


def _energy_gap(rate: float) -> float:
    """Share of the supply's energy that half a second of flight cannot account for; trapezoids, open loop."""
    body, steps = true_body(CLEAN), round(0.5 * rate)
    volts = np.tile([7.0, 6.0, 7.5, 6.5], (steps + 1, 1))
    trace = _open_loop(CLEAN, volts, 1.0 / rate)
    y, i, m = trace[:, :17], trace[:, 17:21], body.motors
    v = np.einsum("tji,tj->ti", rotation(y[:, 6:10]), y[:, 3:6])
    climb = v[:, 2:] + np.cross(y[:, None, 10:13], body.rotors[None])[:, :, 2]
    ground = np.array([core.ground_effect(z, body.ground) for z in y[:, 2]])
    W = y[:, 13:]
    supply = (volts * i).sum(axis=1)
    copper = (m[:, 3] * i**2).sum(axis=1)
    air = (ground[:, None] * m[:, 0] * W**2 * climb).sum(axis=1) - v**2 @ np.array(CLEAN.air.drag)
    air -= (m[:, 1] * W**2 * (W + SPINS * y[:, 12:13])).sum(axis=1)
    stored = [energy(row, body) + 0.5 * m[:, 4] @ c**2 for row, c in zip(y[[0, -1]], i[[0, -1]], strict=True)]
    given, kept = (trapezoid(power, dx=1.0 / rate) for power in (supply, supply - copper + air))
    return float(abs(kept - (stored[1] - stored[0])) / given)


def _open_loop(p: FlightParameters, volts: Array, h: float, body: core.Body | None = None) -> Array:
    """Trace under given voltages from a spinning start."""
    steps = len(volts)
    y = np.zeros(17)
    y[2], y[3:6], y[6], y[10:13], y[13:] = 3.0, [1.0, -2.0, 0.5], 1.0, [0.5, -0.4, 0.3], 340.0
    air = np.column_stack([np.zeros((steps, 3)), np.ones(steps)])
    trace, why = core.fly(
        np.zeros((steps, 9)), volts, air, np.zeros((steps, 6)), y, np.full(4, 1.4), np.zeros(3), h,
        true_body(p) if body is None else body, control(p, 1.0 / h, core.OPEN_LOOP), NOWHERE, -1e9,
    )  # fmt: skip
    assert why == core.FLOWN
    return trace


@given(seed=seeds)
def test_air_only_takes(seed: int) -> None:
    """Drag, and the share of bent rotors, never feed the motion of the body."""
    y, _ = random_state(seed)
    velocity = np.concatenate([rotation(y[None, 6:10])[0].T @ y[3:6], y[10:13]])
    none = changed(CLEAN, drag=(0.0, 0.0, 0.0))
    base = np.concatenate(push(y, np.zeros(4), true_body(none)))
    for air in (
        {"drag": (0.3, 0.2, 0.1)},
        {"drag": (0.0, 0.0, 0.0), "quadratic": 0.05},
        {"drag": (0.0, 0.0, 0.0), "flapping": 0.5},
        {"drag": (0.0, 0.0, 0.0), "inflow": 0.5},
    ):
        lost = np.concatenate(push(y, np.zeros(4), true_body(changed(CLEAN, **air)))) - base
        assert lost @ velocity < 0.0, air


@given(seed=seeds)
def test_the_gyroscopic_torque_does_no_work(seed: int) -> None:
    body = _alone(ROUGH)
    y, _ = random_state(seed)
    alpha = derivative(y, np.zeros(4), body)[10:13]
    turning = np.linalg.inv(body.free_inverse) @ alpha
    assert np.linalg.norm(turning) > 0.0
    assert turning @ y[10:13] == pytest.approx(0.0, abs=1e-12)


def _alone(p: FlightParameters) -> core.Body:
    """The body without air: no thrust, no drag."""
    body = true_body(p)
    motors = body.motors.copy()
    motors[:, :2] = 0.0
    return body._replace(motors=motors, drag=np.zeros(3), quadratic=0.0, tilt=0.0, hub=0.0)


def test_momentum_is_kept_while_the_motors_work() -> None:
    """Without air the motors can only trade momentum with the body, and the body falls."""
    body = _alone(ROUGH)
    trace = _open_loop(ROUGH, np.tile([9.0, 3.0, 8.0, 5.0], (1001, 1)), 1e-3, body)
    y = trace[:, :17]
    spin = y[:, 13:] @ (SPINS * body.motors[:, 5])
    inside = y[:, 10:13] @ body.inertia + spin[:, None] * [0.0, 0.0, 1.0]
    momentum = np.einsum("tij,tj->ti", rotation(y[:, 6:10]), inside)
    assert np.ptp(spin) > 1e-3
    np.testing.assert_allclose(momentum - momentum[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(y[-1, 3:6], y[0, 3:6] - [0.0, 0.0, 9.81], atol=1e-11)


def test_ground_effect_vanishes_with_height() -> None:
    p = true_body(CLEAN).ground
    z = np.geomspace(CLEAN.air.lowest, 1000.0, 200)
    gain = np.array([core.ground_effect(height, p) for height in z]) - 1.0
    assert (gain > 0.0).all()
    assert (np.diff(gain) < 0.0).all()
    # far off every image sits below the vehicle: (1 + K_b) R^2 / (4 z^2)
    assert gain[-1] == pytest.approx(3.0 * 0.1**2 / (4.0 * z[-1] ** 2), rel=1e-4)
    assert core.ground_effect(0.5, p) == pytest.approx(1.026, abs=0.001)
    assert core.ground_effect(0.25, p) == pytest.approx(1.08, abs=0.005)
    assert core.ground_effect(0.0, p) == core.ground_effect(CLEAN.air.lowest, p)
    off = true_body(changed(CLEAN, ground_effect=False)).ground
    assert core.ground_effect(0.1, off) == 1.0


@pytest.mark.parametrize(("inductance", "order"), [(0.0, 4), (1e-3, 2)])
def test_integration_has_its_order(inductance: float, order: int) -> None:
    motor = msgspec.structs.replace(CLEAN.motor, inductance=inductance)
    p = msgspec.structs.replace(CLEAN, motor=motor)
    # steps of a stiff current must be well below L/R = 1.7 ms before an order shows
    coarsest = 40 if inductance == 0.0 else 640
    ends = [
        _open_loop(p, np.tile([8.0, 5.0, 7.0, 6.0], (n + 1, 1)), 0.32 / n)[-1, :17]
        for n in (coarsest, 2 * coarsest, 4 * coarsest)
    ]
    coarse, fine = ends[1] - ends[0], ends[2] - ends[1]
    for part in (slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13), slice(13, 17)):
        ratio = np.linalg.norm(coarse[part]) / np.linalg.norm(fine[part])
        if order == 4:
            assert ratio == pytest.approx(16.0, rel=0.25)
        else:  # at least quadratic: the frozen ramp of the back-EMF is forgotten within L/R
            assert ratio > 3.9


def test_a_motor_reaches_the_speed_of_its_voltage() -> None:
    p = changed(CLEAN, drag=(0.0, 0.0, 0.0))
    speed = _open_loop(p, np.full((1500, 4), 7.0), 1e-3)[-1, 13:17]
    np.testing.assert_allclose(p.nominal.steady_voltage(speed), 7.0, rtol=1e-5)


def test_thrust_is_tilted_no_more_than_allowed() -> None:
    """Far off on the diagonal both axes ask for 6 m/s^2, which would be 0.71 rad; 0.6 are allowed."""
    vehicle = simulated_vehicle("quadrotor")
    t = np.arange(15000) / 1000.0
    far = np.tile([8.0, 8.0, 3.0], (len(t), 1))
    far[0] = [0.0, 0.0, 3.0]
    flight = vehicle.fly(FlightPlan(t, far, np.zeros_like(far)), None)
    tilt = np.arccos(flight.R_world_body[:, 2, 2])
    assert tilt[200:700].max() == pytest.approx(0.6, abs=0.02)
    assert np.abs(flight.command).max() <= vehicle.vehicle.voltage_limit
    assert flight.ended is None
    np.testing.assert_allclose(flight.position[-1], far[-1], atol=0.2)


def _circle(vehicle: SimulatedVehicle, drag: Array, speed: float = 1.5) -> FlightPlan:
    """Radius 3 m, with the acceleration that a vehicle with this drag over mass (3,) needs."""
    t = np.arange(round(8.0 * vehicle.rate)) / vehicle.rate
    w, zero = speed / 3.0, np.zeros_like(t)
    position = 3.0 * np.column_stack([np.cos(w * t), np.sin(w * t), zero]) + [0.0, 0.0, 2.0]
    velocity = 3.0 * w * np.column_stack([-np.sin(w * t), np.cos(w * t), zero])
    ff = -(w**2) * (position - [0.0, 0.0, 2.0]) + drag * velocity
    return FlightPlan(t, position, velocity, ff)


def _error(flight: Flight, plan: FlightPlan) -> float:
    return float(np.linalg.norm(flight.position - plan.position, axis=1)[4000:].mean())


def test_feedforward_of_the_true_drag_is_worth_most_of_the_error() -> None:
    vehicle = simulated_vehicle("quadrotor")
    drag = vehicle.parameters.drag_per_mass
    np.testing.assert_allclose(drag, [0.25 / 0.436, 0.25 / 0.436, 0.0])
    plan, blind = _circle(vehicle, drag), _circle(vehicle, np.zeros(3))
    none = replace(plan, acceleration_ff=None)
    exact, no_drag, feedback = (
        _error(vehicle.fly(p, np.random.default_rng(1), start="moving"), p) for p in (plan, blind, none)
    )
    assert exact < 0.3 * no_drag
    assert no_drag < feedback


def test_a_voltage_fed_forward_lifts() -> None:
    vehicle = simulated_vehicle("quadrotor")
    plan = replace(_circle(vehicle, np.zeros(3)), voltage_ff=np.full((8000, 4), 0.3))
    with_it, without = vehicle.fly(plan, None), vehicle.fly(replace(plan, voltage_ff=None), None)
    np.testing.assert_allclose(with_it.command[0], without.command[0] + 0.3)
    assert with_it.position[300, 2] > without.position[300, 2] + 0.005


def test_the_owner_of_the_rough_vehicle_knows_the_clean_one() -> None:
    clean, rough = simulated_vehicle("quadrotor"), simulated_vehicle("quadrotor_rough")
    assert rough.vehicle == clean.vehicle
    assert true_body(rough.parameters).mass > clean.vehicle.mass
    volts = clean.vehicle.hover_voltage
    assert np.ptp(rough.fly(_circle(rough, np.zeros(3)), None).command.mean(axis=0)) > 0.02 * volts


def test_the_payload_moves_the_centre_and_adds_inertia_by_parallel_axes() -> None:
    body, p = true_body(ROUGH), ROUGH
    m, M, r = p.payload.mass, p.body.mass, np.array(p.payload.place)
    reduced = m * M / (m + M)
    np.testing.assert_allclose(
        body.inertia, np.diag(p.body.inertia) + reduced * (r @ r * np.eye(3) - np.outer(r, r)), rtol=1e-12
    )
    np.testing.assert_allclose(body.rotors.mean(axis=0), -m * r / (m + M))


@settings(max_examples=3)
@given(seed=seeds)
def test_noise_has_its_deviation_and_moves_the_vehicle(seed: int) -> None:
    vehicle = simulated_vehicle("quadrotor")
    plan = _circle(vehicle, np.zeros(3))
    calm, noisy = vehicle.fly(plan, None), vehicle.fly(plan, np.random.default_rng(seed))
    low = replace(vehicle, noise="low").fly(plan, np.random.default_rng(seed))
    for flight, linear, angular in ((noisy, 0.1, 0.5), (low, 0.05, 0.1)):
        jumps = np.diff(flight.acceleration, axis=0)[100:] / math.sqrt(2.0)
        turns = np.diff(flight.angular_acceleration, axis=0)[100:] / math.sqrt(2.0)
        assert jumps.std() == pytest.approx(linear, rel=0.05)
        assert turns.std() == pytest.approx(angular, rel=0.08)
        integral = np.cumsum(flight.acceleration, axis=0)[:-1] / vehicle.rate
        np.testing.assert_allclose(flight.velocity[1:] - flight.velocity[0], integral, atol=0.02)
    assert np.abs(noisy.position - calm.position).max() > 1e-4
