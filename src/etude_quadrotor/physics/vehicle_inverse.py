"""Inverse model of a multirotor from its physics: motor voltages from states, nominal or with coefficients.

    thrust = m f_z,  moments = J α + ω × J ω,  W² = A⁻¹ [thrust, moments],  V = (R kq / Ke) W² + Ke W

with A the vehicle's allocation: the map from states to voltages of thesis 5, steady in the motors. The term
of the rotors' acceleration, (R Jr / Ke) dW/dt, is left out, because dW/dt needs the jerk, which no state
contains. In slow flight the term is about a thousandth of a volt. Nothing here knows a simulator's formulas.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from etude._runtime.operators import Piece
from etude.types import Array, Code, Log, Mask
from etude_quadrotor.channels import hovering
from etude_quadrotor.physics.linear_inverse import map_fit
from etude_quadrotor.vehicle import GRAVITY, Vehicle

SHARED = (
    "drag_lateral",
    "drag_vertical",
    "ground_near",
    "ground_far",
    "back_emf",
    "thrust",
    "moment_x",
    "moment_y",
    "moment_z",
)
"""Coefficients of least squares besides the trims, each 0 in the nominal model.

drag_lateral: moment of the drag of body x and y, which acts off the centre, N m per m/s. drag_vertical: N per
m/s. ground_near, ground_far: part of the thrust that the ground gives at altitude 0. The next five are
relative: the back-EMF constant, the thrust's deviation from the weight, the moments. trim: a constant of each
motor, V, for motors that differ and a payload off the centre. Near hover a back-EMF and four equal trims look
alike: the prior shares the effect between them, the prediction is the same.
"""
BACK_EMF = SHARED.index("back_emf")
TRIM = len(SHARED)
NEAR, FAR = 1.5, 5.0
"""Heights over which the ground effect decays by a factor e, in arm lengths. A generic form: two
exponentials, whatever the vehicle's true curve."""


def coefficient_names(vehicle: Vehicle) -> tuple[str, ...]:
    """(9 + n) SHARED, then a trim for each of the n motors."""
    return (*SHARED, *(f"trim_{i + 1}" for i in range(len(vehicle.spins))))


@dataclass(frozen=True)
class VehicleInverse:
    """Voltages of a vehicle whose constants are known, corrected by `coefficients`. A `protocols.Mean`.

    Attributes:
        vehicle: nominal body and motors.
        coefficients: (9 + n,) in the order of `coefficient_names`; zero for the nominal model.
        deviation: (9 + n,) of the coefficients, infinite if data are not informative; None for the nominal
            model.
    """

    vehicle: Vehicle
    coefficients: Array
    deviation: Array | None = None

    def parameters(self) -> Mapping[str, tuple[float, float]]:
        """Identified coefficients and their deviations; none for the nominal model."""
        if self.deviation is None:
            return {}
        pairs = zip(self.coefficients.tolist(), self.deviation.tolist(), strict=True)
        return dict(zip(coefficient_names(self.vehicle), pairs, strict=True))

    def arrays(self) -> Mapping[str, Array]:
        """What it was identified to be."""
        stored = {"coefficients": self.coefficients}
        return stored if self.deviation is None else stored | {"deviation": self.deviation}

    def predict(self, log: Log) -> Array:
        """Voltages (T, n); terms of a velocity or altitude that the log lacks drop out."""
        return self.linearised(log)[0]

    def static(self, log: Log) -> Array:
        """Voltages (T, n) that would hold the vehicle where it is."""
        return self.predict(hovering(log))

    def c(self, name: str) -> Code:
        """C99 of it."""
        from etude_quadrotor.c99 import vehicle_code

        return vehicle_code(name, self, (NEAR, FAR))

    def onnx(self) -> Piece:
        """In operators of ONNX."""
        from etude_quadrotor.onnx import vehicle_piece

        return vehicle_piece(self, (NEAR, FAR))

    def linearised(self, log: Log) -> tuple[Array, Array]:
        """Voltages (T, n) and their derivative (T, n, 9 + n) in the coefficients."""
        vehicle, theta = self.vehicle, self.coefficients
        load, change = load_terms(vehicle, log)
        inverse = vehicle.mixer()
        squared = (load + change @ theta) @ inverse.T
        speed = np.sqrt(np.maximum(squared, 0.0))
        by_speed = vehicle.motor_constant * (1.0 + theta[BACK_EMF])
        voltage = vehicle.steady_voltage(speed) + vehicle.motor_constant * theta[BACK_EMF] * speed
        voltage += theta[TRIM:]
        slope = vehicle.resistance * vehicle.torque_constant / vehicle.motor_constant
        flows = squared > 0.0  # a rotor cannot spin backwards: it stops, whatever the coefficients
        gain = np.where(flows, slope + 0.5 * by_speed / np.where(flows, speed, 1.0), 0.0)
        jacobian = gain[:, :, None] * np.einsum("rl,tlp->trp", inverse, change)
        jacobian[:, :, BACK_EMF] = vehicle.motor_constant * speed
        jacobian[:, :, TRIM:] = np.eye(len(inverse))
        return voltage, jacobian


def nominal_inverse(vehicle: Vehicle) -> VehicleInverse:
    """The model without drag and ground effect: thesis 5's analytic baseline."""
    return VehicleInverse(vehicle, np.zeros(len(coefficient_names(vehicle))))


def identify_vehicle(
    vehicle: Vehicle,
    log: Log,
    weight: float = 0.2,
    *,
    trims: bool = True,
    use: Mask | None = None,
) -> VehicleInverse:
    """The coefficients (MAP least squares) that explain the voltages in a log.

    Free gains let least squares shrink noisy accelerations. A coefficient without data stays 0.

    Args:
        weight: votes of one sample against the prior: neighbours within a correlation time share one.
        trims: whether each motor has a constant of its own.
        use: (T, n) which voltages say something; None: all.

    Raises:
        DataError: NaN in states or command, or no sample.
    """
    every = len(coefficient_names(vehicle))
    free = every if trims else TRIM
    none = np.zeros(every - free)

    def linearised(theta: Array) -> tuple[Array, Array]:
        voltage, jacobian = VehicleInverse(vehicle, np.append(theta, none)).linearised(log)
        return voltage, jacobian[:, :, :free]

    theta, left = map_fit(linearised, log["command"], prior_deviation(vehicle)[:free], weight, use)
    return VehicleInverse(vehicle, np.append(theta, none), np.append(left, none + np.inf))


def prior_deviation(vehicle: Vehicle) -> Array:
    """(9 + n,) prior deviation of each coefficient from nominal, in physical scale."""
    drag = vehicle.mass  # N per m/s: the drag would stop the vehicle within about a second
    # V: motors and propellers of one kind differ by some per cent
    trim = 0.1 * vehicle.hover_voltage
    # moments and forces of drag, then parts of the nominal coefficients, then volts of trim
    return np.array(
        [drag * vehicle.arm, drag, 0.5, 0.5, 0.2, 1.0, 1.0, 1.0, 1.0, *[trim] * len(vehicle.spins)]
    )


def load_terms(vehicle: Vehicle, log: Log) -> tuple[Array, Array]:
    """Thrust and moments (T, 4) of the nominal model; their derivative (T, 4, 9 + n) in the coefficients."""
    inertia = np.array(vehicle.inertia)
    lift, rates = vehicle.mass * log["specific_force"][:, 2], log["rates"]
    # Euler's equation in the body frame
    moments = inertia * log["angular_acceleration"] + np.cross(rates, inertia * rates)
    change = np.zeros((len(lift), 4, len(coefficient_names(vehicle))))
    velocity, altitude = log.get("body_velocity"), log.get("altitude")
    if velocity is not None:
        # drag -D v at height h above the centre turns it by h D (v_y, -v_x), which the rotors hold
        change[:, 1, 0], change[:, 2, 0] = -velocity[:, 1], velocity[:, 0]
        change[:, 0, 1] = velocity[:, 2]
    if altitude is not None:
        height = np.maximum(altitude[:, 0], 0.0) / vehicle.arm
        change[:, 0, 2], change[:, 0, 3] = -lift * np.exp(-height / NEAR), -lift * np.exp(-height / FAR)
    change[:, 0, 5] = lift - vehicle.mass * GRAVITY
    for axis in range(3):
        change[:, 1 + axis, 6 + axis] = moments[:, axis]
    return np.column_stack([lift, moments]), change
