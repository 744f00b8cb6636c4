"""ONNX operators of a vehicle's inverse models."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from etude._runtime.operators import Piece, Value, cross, joined
from etude_quadrotor.vehicle import GRAVITY

FORCE, RATES, TURNING = "specific_force", "rates", "angular_acceleration"


def vehicle_piece(model: Any, heights: tuple[float, float]) -> Piece:
    """Operators of a `VehicleInverse`: voltages from Euler's equation, the allocation and steady motors."""
    vehicle, theta = model.vehicle, model.coefficients
    reads: tuple[str, ...] = (FORCE, RATES, TURNING)
    reads += ("body_velocity",) * bool(theta[:2].any()) + ("altitude",) * bool(theta[2:4].any())
    slope = vehicle.resistance * vehicle.torque_constant / vehicle.motor_constant
    by_speed = vehicle.motor_constant * (1.0 + theta[4])

    def draw(states: Mapping[str, Value], _: Value | None) -> tuple[Value, None]:
        load = _load(model, states, heights)
        squares = (load @ vehicle.mixer().T).most(0.0)
        return slope * squares + by_speed * squares.of("Sqrt") + theta[9:], None

    return Piece(reads, draw)


def _load(model: Any, states: Mapping[str, Value], heights: tuple[float, float]) -> Value:
    """Thrust and moments (n, 4)."""
    vehicle, theta = model.vehicle, model.coefficients
    inertia = np.array(vehicle.inertia)
    lift, rates = vehicle.mass * states[FORCE].at([2]), states[RATES]
    thrust = lift + theta[5] * (lift - vehicle.mass * GRAVITY)
    turning = states[TURNING] * inertia + cross(rates, rates * inertia)
    moments = turning * (1.0 + theta[6:9])
    if theta[:2].any():
        velocity = states["body_velocity"]
        thrust = thrust + theta[1] * velocity.at([2])
        moments = moments + velocity.at([1, 0, 2]) * (theta[0] * np.array([-1.0, 1.0, 0.0]))
    if theta[2:4].any():
        height = states["altitude"].most(0.0) / vehicle.arm
        for gain, length in zip(theta[2:4], heights, strict=True):
            thrust = thrust - float(gain) * lift * (-(height / length)).of("Exp")
    load: Value = joined([thrust, moments])
    return load


def features_piece(model: Any, least_lift: float) -> Piece:
    """Operators of a `LinearInverse`: least squares on physical features."""
    reads = (FORCE, RATES, TURNING, *model.uses)

    def draw(states: Mapping[str, Value], _: Value | None) -> tuple[Value, None]:
        force, rates, alpha = (states[name] for name in reads[:3])
        root = (force.at([2]) / GRAVITY).most(least_lift).of("Sqrt")
        products = rates.at([1, 2, 0]) * rates.at([2, 0, 1])
        columns = [force, root, rates, products, alpha, alpha / root, *(states[name] for name in model.uses)]
        return (joined(columns) - model.centre) / model.spread @ model.weights + model.offset, None

    return Piece(reads, draw)
