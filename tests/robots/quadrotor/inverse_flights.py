"""Flights without a simulator: random Fourier motions of the body, and the voltages of a simple truth."""

from __future__ import annotations

import numpy as np

from etude.logs.flight.log import FlightLog
from etude.models.flight.dataset import FlightDataset
from etude.models.physics.flight_inverse import VehicleInverse
from etude.robots.flight_spec import FlightSpec
from etude.robots.vehicle import GRAVITY, Vehicle
from etude.trajectories.flight.states import FlightStates, join_states

VEHICLE = Vehicle(
    mass=0.436,
    inertia=(2.24e-3, 2.24e-3, 4.0e-3),
    arm=0.178,
    thrust_constant=9.1e-6,
    torque_constant=1.8e-7,
    motor_constant=0.01466,
    resistance=0.6,
    rotor_inertia=2.4e-5,
    voltage_limit=11.1,
)
MOTORS = ("m1", "m2", "m3", "m4")
SPEC = FlightSpec(
    name="test",
    lower=(-10.0, -10.0, 0.0),
    upper=(10.0, 10.0, 5.0),
    speed=6.0,
    command_names=MOTORS,
    command_unit="V",
    command_lower=(0.0,) * 4,
    command_upper=(11.1,) * 4,
    rate=10.0,
    vehicle=VEHICLE,
)
TRUTH = np.array([0.002, 0.1, 0.15, 0.05, 0.05, 0.04, 0.1, -0.1, 0.15, 0.05, -0.05, 0.02, 0.0])
"""Coefficients of the vehicle of the tests."""


def random_states(rng: np.random.Generator, seconds: float = 30.0, rate: float = 10.0) -> FlightStates:
    """Smooth random quantities in the ranges of a brisk flight; altitudes down to 0.3 m."""
    t = np.arange(0.0, seconds, 1.0 / rate)

    def waves(width: int, size: float) -> np.ndarray:
        w, phase = rng.uniform(0.4, 2.0, (3, width)), rng.uniform(0.0, 6.28, (3, width))
        return size * np.sin(t[:, None, None] * w + phase).sum(axis=1) / 1.5

    force = waves(3, 0.8) + np.array([0.0, 0.0, GRAVITY])
    altitude = 2.0 + 1.7 * np.sin(rng.uniform(0.3, 0.6) * t + rng.uniform(0.0, 6.28))
    acceleration = force - [0.0, 0.0, GRAVITY]
    return FlightStates(altitude, force, waves(3, 0.6), waves(3, 2.0), waves(3, 2.0), acceleration)


def voltages(states: FlightStates, truth: np.ndarray = TRUTH) -> np.ndarray:
    return VehicleInverse(VEHICLE, truth).predict(states)


def rough(states: FlightStates) -> np.ndarray:
    """What no coefficient has: gusts of thrust with speed, and motors that differ."""
    assert states.velocity is not None
    lift = 0.25 * np.sin(1.3 * states.velocity[:, 0]) * np.cos(0.8 * states.velocity[:, 1])
    return lift[:, None] * [1.0, 0.7, 1.2, 0.9] + [0.1, -0.1, 0.05, 0.0]


def flights(count: int, *, seed: int = 0, noise: float = 0.003, hard: bool = False) -> FlightDataset:
    """`count` flights of 30 s at 10 Hz."""
    rng = np.random.default_rng(seed)
    parts = [random_states(rng) for _ in range(count)]
    states = join_states(parts)
    command = voltages(states) + (rough(states) if hard else 0.0) + noise * rng.normal(size=(len(states), 4))
    group = np.repeat(np.arange(count), len(parts[0]))
    return FlightDataset(states, command, group, np.tile(np.arange(len(parts[0])) / 10.0, count))


def log_of(data: FlightDataset, unit: str = "V") -> FlightLog:
    return FlightLog(data.t, data.states, data.command, MOTORS, unit, source="flight.csv")
