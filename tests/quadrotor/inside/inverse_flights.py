"""Flights without a simulator: random waves of the body's states, and the voltages of a simple truth."""

from __future__ import annotations

import numpy as np

from etude.types import Array, Log, Samples
from etude_quadrotor import QuadrotorSpec
from etude_quadrotor.channels import STATES, command
from etude_quadrotor.physics.vehicle_inverse import VehicleInverse
from etude_quadrotor.vehicle import GRAVITY, Vehicle

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
SPEC = QuadrotorSpec(
    name="test",
    lower=(-10.0, -10.0, 0.0),
    upper=(10.0, 10.0, 5.0),
    speed=6.0,
    command_names=("m1", "m2", "m3", "m4"),
    command_unit="V",
    command_lower=(0.0,) * 4,
    command_upper=(11.1,) * 4,
    rate=10.0,
    vehicle=VEHICLE,
)
TRUTH = np.array([0.002, 0.1, 0.15, 0.05, 0.05, 0.04, 0.1, -0.1, 0.15, 0.05, -0.05, 0.02, 0.0])
"""Coefficients of the vehicle of the tests."""


def log_with(t: Array, **states: Array) -> Log:
    """A log of these states; a channel of one part may be given as (T,)."""
    log = Log(t, {}, {}, "flight.csv")
    for channel in STATES:
        if channel.name in states:
            log = log.put(channel, states[channel.name].reshape(len(t), -1))
    return log


def random_log(rng: np.random.Generator, seconds: float = 30.0, rate: float = 10.0) -> Log:
    """Smooth random states in the ranges of a brisk flight; altitudes down to 0.3 m."""
    t = np.arange(0.0, seconds, 1.0 / rate)

    def waves(width: int, size: float) -> Array:
        w, phase = rng.uniform(0.4, 2.0, (3, width)), rng.uniform(0.0, 6.28, (3, width))
        return size * np.sin(t[:, None, None] * w + phase).sum(axis=1) / 1.5

    force = waves(3, 0.8) + np.array([0.0, 0.0, GRAVITY])
    altitude = 2.0 + 1.7 * np.sin(rng.uniform(0.3, 0.6) * t + rng.uniform(0.0, 6.28))
    rates, alpha, velocity = waves(3, 0.6), waves(3, 2.0), waves(3, 2.0)
    return log_with(
        t,
        altitude=altitude,
        specific_force=force,
        rates=rates,
        angular_acceleration=alpha,
        body_velocity=velocity,
        body_acceleration=force - [0.0, 0.0, GRAVITY],
    )


def voltages(log: Log, truth: Array = TRUTH) -> Array:
    return VehicleInverse(VEHICLE, truth).predict(log)


def flown(seed: int = 0, noise: float = 0.003) -> Log:
    """A random log with the voltages of the truth."""
    rng = np.random.default_rng(seed)
    log = random_log(rng)
    return log.put(command(SPEC), voltages(log) + noise * rng.normal(size=(len(log), 4)))


def samples_of(log: Log, group: Array | None = None) -> Samples:
    """A log as samples, all of them usable."""
    numbers = np.zeros(len(log), dtype=np.int64) if group is None else group.astype(np.int64)
    every = np.ones((len(log), 4), dtype=np.bool_)
    return Samples(log, numbers, every, every)


def flights(count: int, *, seed: int = 0, noise: float = 0.003) -> Samples:
    """`count` flights of 30 s at 10 Hz."""
    from etude.types import joined_samples

    rng = np.random.default_rng(seed)
    parts = []
    for number in range(count):
        log = random_log(rng)
        parts.append(samples_of(log, np.full(len(log), float(number))))
    joined = joined_samples(parts)
    spoken = voltages(joined.log) + noise * rng.normal(size=(len(joined), 4))
    return samples_of(joined.log.put(command(SPEC), spoken), joined.group)
