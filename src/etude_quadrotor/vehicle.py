"""Vehicle: parameters of a multirotor's body and motors, as far as its owner knows them.

Body frame: x forward, y left, z up. Rotors lie in a plane and lift along z; unless told, four arms are an X.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

GRAVITY = 9.81
"""m/s^2."""
CORNERS = ((1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0))
"""Signs of (x, y) of the rotors: front right, back right, back left, front left."""
SPINS = (1.0, -1.0, 1.0, -1.0)
"""+1: rotates about +z (counter-clockwise from above), so its drag torque on the body is about -z."""


Rotor = tuple[float, float, float]
"""x and y in the body frame, m, and spin, one of SPINS."""


@dataclass(frozen=True)
class Vehicle:
    """A rigid body with direct-current motors; thrust and drag torque are quadratic in rotor speed.

    Attributes:
        mass: kg.
        inertia: (Jx, Jy, Jz) about the centre of mass, kg m^2.
        arm: distance of each rotor from the centre, m.
        thrust_constant: kf, thrust = kf W^2, N s^2.
        torque_constant: kq, drag torque = kq W^2, N m s^2.
        motor_constant: Ke = Kt seen at the rotor, V s (N m/A).
        resistance: ohm.
        rotor_inertia: of rotor, gear and motor, seen at the rotor, kg m^2.
        voltage_limit: largest voltage of a motor, V; the least is 0.
        layout: the rotors in the order of the commands; (): four in an X.
    """

    mass: float
    inertia: tuple[float, float, float]
    arm: float
    thrust_constant: float
    torque_constant: float
    motor_constant: float
    resistance: float
    rotor_inertia: float
    voltage_limit: float
    layout: tuple[Rotor, ...] = field(default=(), repr=False)

    @property
    def rotors(self) -> Array:
        """(n, 2) positions x, y of the rotors in the body frame, m."""
        if self.layout:
            return np.array(self.layout)[:, :2]
        return np.array(CORNERS) * (self.arm / math.sqrt(2.0))

    @property
    def spins(self) -> Array:
        """(n,) as of SPINS."""
        return np.array(self.layout)[:, 2] if self.layout else np.array(SPINS)

    def allocation(self) -> Array:
        """(4, n) matrix from squared rotor speeds to thrust, N, and moments about x, y, z, N m."""
        x, y = self.rotors.T
        kf, kq = self.thrust_constant, self.torque_constant
        return np.stack([np.full(len(x), kf), kf * y, -kf * x, -kq * self.spins])

    def mixer(self) -> Array:
        """(n, 4) from thrust and moments to squared rotor speeds: of more than four the least, as allocators
        choose them.
        """
        allocation = self.allocation()
        square = len(allocation.T) == len(allocation)
        return np.asarray(np.linalg.inv(allocation) if square else np.linalg.pinv(allocation))

    def steady_voltage(self, speed: Array) -> Array:
        """Voltages (...,) V that hold rotor speeds (...,) rad/s: back-EMF, and the current against drag."""
        current = self.torque_constant * speed * np.abs(speed) / self.motor_constant
        return np.asarray(self.resistance * current + self.motor_constant * speed)

    @property
    def hover_speed(self) -> float:
        """Rotor speed at which all rotors carry the weight, rad/s."""
        return math.sqrt(self.mass * GRAVITY / (len(self.spins) * self.thrust_constant))

    @property
    def hover_voltage(self) -> float:
        """V."""
        return float(self.steady_voltage(np.array(self.hover_speed)))
