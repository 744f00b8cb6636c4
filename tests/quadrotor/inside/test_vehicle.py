"""The vehicle's constants: hover in closed form, moments by cross product."""

import math

import numpy as np
import pytest

from etude_quadrotor.vehicle import CORNERS, GRAVITY, SPINS, Vehicle

DRONE = Vehicle(0.436, (2.24e-3, 2.24e-3, 4.0e-3), 0.178, 9.1e-6, 1.8e-7, 0.01466, 0.6, 2.4e-5, 11.1)


def test_hover_carries_the_weight_without_a_moment():
    wrench = DRONE.allocation() @ np.full(4, DRONE.hover_speed**2)
    np.testing.assert_allclose(wrench, [DRONE.mass * GRAVITY, 0.0, 0.0, 0.0], atol=1e-12)
    # an AR.Drone hovers at some 343 rad/s and 5.9 V
    assert DRONE.hover_speed == pytest.approx(343, abs=1)
    assert DRONE.hover_voltage == pytest.approx(5.89, abs=0.01)


def test_moments_are_lever_times_force():
    speeds = np.array([300.0, 310.0, 330.0, 350.0])
    lift = DRONE.thrust_constant * speeds**2
    moment = np.zeros(3)
    for (x, y), spin, force, speed in zip(DRONE.rotors, SPINS, lift, speeds, strict=True):
        moment += np.cross([x, y, 0.0], [0.0, 0.0, force])
        moment[2] -= spin * DRONE.torque_constant * speed**2
    np.testing.assert_allclose(DRONE.allocation() @ speeds**2, [lift.sum(), *moment], rtol=1e-12)


def test_rotors_sit_on_the_arms():
    np.testing.assert_allclose(np.hypot(*DRONE.rotors.T), DRONE.arm)
    assert [tuple(np.sign(r)) for r in DRONE.rotors] == list(CORNERS)


def test_steady_voltage_balances_the_motor():
    speed = np.array([0.0, 200.0, 400.0])
    current = (DRONE.steady_voltage(speed) - DRONE.motor_constant * speed) / DRONE.resistance
    np.testing.assert_allclose(DRONE.motor_constant * current, DRONE.torque_constant * speed**2, atol=1e-15)
    assert math.isclose(DRONE.steady_voltage(np.array(0.0)), 0.0)
