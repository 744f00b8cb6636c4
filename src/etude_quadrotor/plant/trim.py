"""Trim: the rotor speeds that carry a vehicle, and what its controller has to believe to hold them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude_quadrotor.plant import core
from etude_quadrotor.plant.constants import true_body
from etude_quadrotor.plant.parameters import FlightParameters
from etude_quadrotor.vehicle import GRAVITY, SPINS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Trim:
    """An equilibrium with level rotors.

    Attributes:
        speed, current: (4,) rad/s, A.
        yaw: at which the controller's yaw loop holds the balance, rad; 0 for matched motors.
        total: (3,) integrals of the position error that a vehicle has gathered once it hovers, m s.
    """

    speed: Array
    current: Array
    yaw: float
    total: Array


def trim(p: FlightParameters, height: float, force: float = GRAVITY) -> Trim:
    """Trim at a height above ground, m, for a thrust per mass, m/s^2.

    The controller's static map is that of the nominal vehicle. The difference to the true one shows in it as
    a tilt it asks for, a yaw, and a vertical acceleration; the integrals of a hovering vehicle hold these.
    """
    speed, current, volts = _balance(p, height, force)
    hover = volts if force == GRAVITY else _balance(p, height, GRAVITY)[2]
    thrust, *moments = p.nominal.allocation() @ _believed_speed(p, hover) ** 2
    c, J = p.control, p.nominal.inertia
    left, ahead = -moments[0] / (J[0] * c.attitude[0]), moments[1] / (J[1] * c.attitude[0])
    yaw = -moments[2] / (J[2] * c.yaw[0])
    up = thrust / p.nominal.mass
    slope = np.array([ahead, left]) / np.sqrt(1.0 - ahead**2 - left**2)
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    wish = np.array([*(up * turn @ slope), up - GRAVITY])
    gains = np.array([c.position_xy[2], c.position_xy[2], c.position_z[2]])
    total = np.divide(wish, gains, out=np.zeros(3), where=gains > 0.0)
    return Trim(speed, current, float(yaw), total)


def _balance(p: FlightParameters, height: float, force: float) -> tuple[Array, Array, Array]:
    """(4,) rotor speeds, currents and voltages that give mass * force and no moment."""
    body = true_body(p)
    kf, kq, ke, resistance = body.motors[:, :4].T
    lift = kf * core.ground_effect(height, body.ground)
    x, y = body.rotors[:, 0], body.rotors[:, 1]
    rows = np.stack([lift, y * lift, -x * lift, -np.array(SPINS) * kq])
    square = np.maximum(np.linalg.solve(rows, np.array([body.mass * force, 0.0, 0.0, 0.0])), 0.0)
    speed, current = np.sqrt(square), kq * square / ke
    return speed, current, resistance * current + ke * speed


def _believed_speed(p: FlightParameters, volts: Array) -> Array:
    """(4,) steady speeds of the nominal motors: the positive root of R kq / Ke W^2 + Ke W = V."""
    v = p.nominal
    a = v.resistance * v.torque_constant / v.motor_constant
    return np.asarray((np.sqrt(v.motor_constant**2 + 4.0 * a * volts) - v.motor_constant) / (2.0 * a))
