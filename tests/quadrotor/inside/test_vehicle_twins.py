"""Two quadrotors, written apart, fly the same flight."""

from __future__ import annotations

from dataclasses import replace

import flight_twin
import msgspec
import numpy as np
import pytest

from etude_quadrotor import KIND, Disturbance
from etude_quadrotor.plant.flight_plan import FlightPlan
from etude_quadrotor.plant.simulated_vehicle import PLANTS, SimulatedVehicle, simulated_vehicle


def _plan(vehicle: SimulatedVehicle, seconds: float) -> FlightPlan:
    """Two harmonics on each axis, half way to the walls, down to half a metre."""
    rng = np.random.default_rng(5)
    t = np.arange(round(seconds * vehicle.rate)) / vehicle.rate
    room = KIND.spec(KIND.built_in()[vehicle.name])
    half = 0.5 * (np.array(room.upper) - room.lower)
    position, velocity, acceleration = (np.zeros((len(t), 3)) for _ in range(3))
    position += half + room.lower - [0.0, 0.0, 0.2]
    for n in (1, 2):
        w, (a, b) = n * 2.0 * np.pi / 15.0, 0.25 * half * rng.uniform(-1.0, 1.0, (2, 3))
        cos, sin = np.cos(w * t)[:, None], np.sin(w * t)[:, None]
        position += a * sin + b * cos
        velocity += w * (a * cos - b * sin)
        acceleration -= w**2 * (a * sin + b * cos)
    push = 0.05 * np.column_stack([np.sin(3.0 * t), np.cos(2.0 * t), -np.sin(t), 0.5 * np.cos(t)])
    if vehicle.parameters.control.inputs == "set_points":
        push *= 0.1
    return FlightPlan(t, position, velocity, acceleration, push)


def _difference(vehicle: SimulatedVehicle, plan: FlightPlan, seed: int | None, start: str) -> float:
    """Largest difference of any channel, over that channel's range."""
    windy = Disturbance(wind=(1.0, -0.5, 0.2), gust=(0.0, 2.0, 0.0), gust_start=0.3, sag_rate=0.001)
    disturbance = None if seed is None else windy
    rng = None if seed is None else np.random.default_rng(seed)
    one = vehicle.fly(plan, rng, start=start, disturbance=disturbance)
    assert one.ended is None
    noise = np.zeros((len(plan), 6))
    if seed is not None:
        noise = np.random.default_rng(seed).standard_normal(noise.shape)
        noise *= np.repeat(vehicle.parameters.noise[vehicle.noise], 3)
    air = (disturbance or Disturbance()).over(plan.t)
    two = flight_twin.fly(vehicle.parameters, plan, *vehicle.start_state(plan, start), air, noise)
    return max(
        float(np.abs(getattr(one, name) - rows).max() / max(np.abs(rows).max(), 1.0))
        for name, rows in two.items()
    )


@pytest.mark.thinned
@pytest.mark.parametrize(("seed", "start"), [(None, "hover"), (4, "moving")])
@pytest.mark.parametrize("name", PLANTS)
def test_the_twins_agree(name: str, seed: int | None, start: str) -> None:
    vehicle = simulated_vehicle(name)
    assert _difference(vehicle, _plan(vehicle, 0.4), seed, start) < 1e-9


def test_the_twins_agree_with_everything_switched_on() -> None:
    clean = simulated_vehicle("quadrotor_rough")
    air = msgspec.structs.replace(clean.parameters.air, inflow=0.4, drag=(0.3, 0.2, 0.1), hub=0.1)
    vehicle = replace(clean, parameters=msgspec.structs.replace(clean.parameters, air=air))
    assert _difference(vehicle, _plan(vehicle, 0.4), 2, "moving") < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANTS)
def test_the_twins_agree_over_a_whole_flight(name: str) -> None:
    vehicle = simulated_vehicle(name)
    assert _difference(vehicle, _plan(vehicle, 30.0), None, "hover") < 1e-9
