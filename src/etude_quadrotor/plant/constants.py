"""From parameters to the arrays that compiled code takes: the true body, and the controller's nominal one."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from etude_quadrotor.plant.core import SET_POINTS, VOLTAGES, Body, Control
from etude_quadrotor.plant.parameters import FlightParameters

Array = NDArray[np.float64]


def true_body(p: FlightParameters) -> Body:
    """The vehicle as it flies, seen from its true centre of mass."""
    mass = p.body.mass + p.payload.mass
    place = np.array(p.payload.place)
    center = p.payload.mass / mass * place
    inertia = np.diag(p.body.inertia) + _points(p.body.mass, center) + _points(p.payload.mass, place - center)
    free = inertia.copy()
    free[2, 2] -= 4.0 * p.motor.inertia
    radius, ground = p.rotor.radius, p.air.ground_effect
    across = 2.0 * p.body.arm
    return Body(
        mass=mass,
        inertia=inertia,
        free_inverse=np.asarray(np.linalg.inv(free), dtype=np.float64),
        rotors=np.column_stack([p.nominal.rotors, np.zeros(4)]) - center,
        motors=_motors(p),
        drag=np.array(p.air.drag),
        quadratic=p.air.quadratic,
        tilt=p.air.flapping / radius,
        hub=p.air.hub * p.air.flapping / radius,
        inflow=p.air.inflow / radius,
        ground=np.array(
            [radius * ground, across / math.sqrt(2.0), across, p.air.body_lift, p.air.lowest],
            dtype=np.float64,
        ),
    )


def control(p: FlightParameters, rate: float, mode: int | None = None) -> Control:
    """The controller on a grid of `rate` Hz; `mode` of `core` if not the vehicle's own."""
    v, c = p.nominal, p.control
    own = VOLTAGES if c.inputs == "voltage" else SET_POINTS
    return Control(
        mode=own if mode is None else mode,
        hold=max(1, round(rate / c.position_rate)),
        mass=v.mass,
        inertia=np.array(v.inertia),
        mixer=np.ascontiguousarray(np.linalg.inv(v.allocation())),
        motor=np.array([v.torque_constant, v.motor_constant, v.resistance, v.voltage_limit]),
        position=np.array([c.position_xy, c.position_xy, c.position_z]),
        clip=c.clip,
        tilt=c.tilt,
        attitude=np.array([*c.attitude, *c.yaw]),
        full_scale=np.array([c.full_tilt, c.full_yaw_rate, c.full_thrust]),
    )


def _points(mass: float, place: Array) -> Array:
    """(3, 3) inertia of a point of mass at `place` (parallel axes)."""
    return np.asarray(mass * (place @ place * np.eye(3) - np.outer(place, place)))


def _motors(p: FlightParameters) -> Array:
    """(4, 6) kf, kq, Ke, R, L, Jr."""
    one, m = np.ones(4), p.mismatch
    return np.column_stack(
        [
            p.rotor.thrust_constant * np.array(m.thrust),
            p.rotor.torque_constant * np.array(m.torque),
            p.motor.constant * np.array(m.constant),
            p.motor.resistance * np.array(m.resistance),
            p.motor.inductance * one,
            p.motor.inertia * one,
        ]
    )
