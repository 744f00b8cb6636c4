"""A second quadrotor, written apart from the first: momenta and rotation matrices in NumPy.

Its state is position, velocity, rotation matrix, angular momentum of the whole vehicle in the world, and each
rotor's own angular momentum. It shares with the first the parameters, the grid of time, the
Runge-Kutta scheme and the exact currents over a ramp of rotor speed, for these define the simulated world.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from etude_quadrotor.plant.flight_plan import FlightPlan
from etude_quadrotor.plant.parameters import FlightParameters

Array = NDArray[np.float64]
UP = np.array([0.0, 0.0, 1.0])
SPIN = np.array([1.0, -1.0, 1.0, -1.0])


def skew(x: Array) -> Array:
    """[x]: the matrix of the cross product."""
    return np.array([[0.0, -x[2], x[1]], [x[2], 0.0, -x[0]], [-x[1], x[0], 0.0]])


def axial(M: Array) -> Array:
    """Sum of a x b for M = sum of a b'."""
    return np.array([M[1, 2] - M[2, 1], M[2, 0] - M[0, 2], M[0, 1] - M[1, 0]])


@dataclass
class State:
    p: Array
    v: Array
    R: Array
    L: Array
    rotor: Array

    def moved(self, slope: list[Array], h: float) -> State:
        return State(*(x + h * dx for x, dx in zip(vars(self).values(), slope, strict=True)))


class Twin:
    def __init__(self, p: FlightParameters) -> None:
        self.p = p
        arm = p.body.arm / np.sqrt(2.0)
        corners = arm * np.array([[1, -1, 0], [-1, -1, 0], [-1, 1, 0], [1, 1, 0]])
        points = [(p.body.mass, np.zeros(3)), (p.payload.mass, np.array(p.payload.place))]
        self.mass = sum(m for m, _ in points)
        center = sum(m * r for m, r in points) / self.mass
        J = np.diag(p.body.inertia)
        for m, r in points:
            cross = np.cross(np.eye(3), r - center)
            J = J + m * cross.T @ cross
        self.free = J - 4.0 * p.motor.inertia * np.outer(UP, UP)
        self.free_inverse = np.linalg.inv(self.free)
        self.hubs = corners - center
        self.square = ((corners - corners[0]) ** 2).sum(axis=1)
        self.kf = p.rotor.thrust_constant * np.array(p.mismatch.thrust)
        self.kq = p.rotor.torque_constant * np.array(p.mismatch.torque)
        self.ke = p.motor.constant * np.array(p.mismatch.constant)
        self.ohm = p.motor.resistance * np.array(p.mismatch.resistance)

    def ground(self, z: float) -> float:
        """One image of each rotor and one of the body (Sanchez-Cuevas et al. 2017)."""
        z, R = max(z, self.p.air.lowest), self.p.rotor.radius
        rotors = 0.5 * R**2 * (z * (self.square + 4.0 * z**2) ** -1.5).sum()
        body = 2.0 * R**2 * self.p.air.body_lift * z * ((2.0 * self.p.body.arm) ** 2 + 4.0 * z**2) ** -1.5
        return float(1.0 / (1.0 - rotors - body))

    def rates(self, s: State) -> Array:
        return self.free_inverse @ (s.R.T @ s.L - (SPIN @ s.rotor) * UP)

    def speeds(self, s: State) -> Array:
        return s.rotor / self.p.motor.inertia - SPIN * self.rates(s)[2]

    def slope(self, s: State, current: Array, wind: Array, noise: Array) -> list[Array]:
        air, w, W = self.p.air, self.rates(s), self.speeds(s)
        v = s.R.T @ (s.v - wind)
        hub = v - self.hubs @ skew(w)
        side = hub * [1.0, 1.0, 0.0]
        ratio = 1.0 / (W * self.p.rotor.radius)
        thrust = self.kf * W * np.abs(W) * self.ground(s.p[2])
        disc = -air.flapping * ratio[:, None] * side
        force = thrust[:, None] * (UP + disc) - (thrust * air.inflow * ratio * hub[:, 2])[:, None] * UP
        drag = -(np.array(air.drag) + air.quadratic * np.linalg.norm(v)) * v
        moment = axial(self.hubs.T @ force) + air.hub * skew(UP) @ disc.sum(axis=0)
        aero = self.kq * W * np.abs(W)
        moment = moment - (SPIN @ aero) * UP + self.free @ noise[3:]
        gravity = np.array([0.0, 0.0, -9.81])
        return [
            s.v,
            s.R @ (force.sum(axis=0) + drag) / self.mass + gravity + noise[:3],
            s.R @ skew(w),
            s.R @ moment,
            self.ke * current - aero,
        ]

    def angular_acceleration(self, s: State, slope: list[Array]) -> Array:
        body, w = s.R.T @ s.L, self.rates(s)
        return self.free_inverse @ (s.R.T @ slope[3] - skew(w) @ body - (SPIN @ slope[4]) * UP)

    def currents(self, start: Array, W: Array, ramp: Array, volts: Array, t: float) -> Array:
        """L di/dt + R i = V - Ke (W + ramp t): the particular solution A + B t and the free decay."""
        B = -self.ke * ramp / self.ohm
        A = (volts - self.ke * W - self.p.motor.inductance * B) / self.ohm
        return A + B * t + (start - A) * np.exp(-self.ohm * t / self.p.motor.inductance)

    def step(
        self, s: State, i: Array, volts: Array, wind: Array, noise: Array, h: float
    ) -> tuple[State, Array]:
        k1 = self.slope(s, i, wind, noise)
        W = self.speeds(s)
        ramp = k1[4] / self.p.motor.inertia - SPIN * self.angular_acceleration(s, k1)[2]
        half, full = (self.currents(i, W, ramp, volts, t) for t in (0.5 * h, h))
        k2 = self.slope(s.moved(k1, 0.5 * h), half, wind, noise)
        k3 = self.slope(s.moved(k2, 0.5 * h), half, wind, noise)
        k4 = self.slope(s.moved(k3, h), full, wind, noise)
        s = s.moved([(a + 2.0 * b + 2.0 * c + d) / 6.0 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)], h)
        s.R = Rotation.from_matrix(s.R).as_matrix()
        return s, full


class Pilot:
    """The cascade of the thesis over rotation matrices; knows the nominal vehicle."""

    def __init__(self, twin: Twin, total: Array) -> None:
        p = twin.p
        self.p, self.twin, self.total = p, twin, total.copy()
        self.P, self.D, self.I = np.array([p.control.position_xy] * 2 + [p.control.position_z]).T
        self.thrust, self.aim, self.command = 0.0, UP, np.zeros(4)

    def position(self, s: State, position: Array, velocity: Array, ff: Array, period: float) -> None:
        c, error = self.p.control, position - s.p
        wish = self.P * error + self.D * (velocity - s.v) + self.I * (self.total + error * period) + ff
        self.total = np.where(np.abs(wish) <= c.clip, self.total + error * period, self.total)
        wish = np.clip(wish, -c.clip, c.clip) + 9.81 * UP
        wish[:2] *= min(1.0, np.tan(c.tilt) * wish[2] / max(np.linalg.norm(wish[:2]), 1e-300))
        self.thrust = self.p.body.mass * wish[2] / max(s.R[2, 2], 0.5)
        self.aim = wish / np.linalg.norm(wish)

    def set_points(self, s: State, ff: Array) -> None:
        c, yaw = self.p.control, _yaw(s)
        aim = Rotation.from_rotvec(-yaw * UP).apply(self.aim)
        # Ry(pitch) Rx(roll) z = aim, read from the matrix whose third column is aim
        roll, pitch = np.arctan2(-aim[1], np.hypot(aim[0], aim[2])), np.arctan2(aim[0], aim[2])
        rate = -c.yaw[0] * yaw / c.yaw[1]
        raw = np.array(
            [roll / c.full_tilt, pitch / c.full_tilt, rate / c.full_yaw_rate, self.thrust / c.full_thrust]
        )
        self.command = np.clip(raw + ff, [-1, -1, -1, 0], 1)

    def volts(self, s: State, ff: Array) -> Array:
        c, J = self.p.control, np.array(self.p.body.inertia)
        w = self.twin.rates(s)
        aim, thrust, yaw = self.aim, self.thrust, _yaw(s)
        turn = -c.yaw[0] * yaw - c.yaw[1] * w[2]
        if c.inputs == "set_points":
            roll, pitch, rate = self.command[:3] * [c.full_tilt, c.full_tilt, c.full_yaw_rate]
            aim = Rotation.from_euler("ZYX", [yaw, pitch, roll]).apply(UP)
            thrust, turn = self.command[3] * c.full_thrust, c.yaw[1] * (rate - w[2])
        tip = skew(UP) @ s.R.T @ aim  # the turn that brings the thrust where it is wanted, body frame
        alpha = c.attitude[0] * tip - c.attitude[1] * w
        alpha[2] = turn
        nominal = self.p.nominal
        square = np.linalg.solve(nominal.allocation(), np.array([thrust, *(J * alpha)]))
        volts = nominal.steady_voltage(np.sqrt(np.maximum(square, 0.0)))
        return np.clip(volts + (ff if c.inputs == "voltage" else 0.0), 0.0, nominal.voltage_limit)


def _yaw(s: State) -> float:
    return float(Rotation.from_matrix(s.R).as_euler("ZYX")[0])


def fly(
    p: FlightParameters, plan: FlightPlan, y: Array, current: Array, total: Array, air: Array, noise: Array
) -> dict[str, Array]:
    """The flight from state y (17,) of the first simulator; air (T, 4) and noise (T, 6) as there."""
    twin, h = Twin(p), 1e-3
    pilot = Pilot(twin, total)
    R = Rotation.from_quat(y[[7, 8, 9, 6]]).as_matrix()
    rotor = p.motor.inertia * (y[13:] + SPIN * y[12])
    s = State(y[:3].copy(), y[3:6].copy(), R, R @ (twin.free @ y[10:13] + SPIN @ rotor * UP), rotor)
    zero = np.zeros((len(plan), 4))
    push = zero[:, :3] if plan.acceleration_ff is None else plan.acceleration_ff
    volts_ff = zero if plan.voltage_ff is None else plan.voltage_ff
    hold, rows = round(1000.0 / p.control.position_rate), []
    for k in range(len(plan)):
        if k % hold == 0:
            pilot.position(s, plan.position[k], plan.velocity[k], push[k], hold * h)
            if p.control.inputs == "set_points":
                pilot.set_points(s, volts_ff[k])
        command = pilot.volts(s, volts_ff[k])
        volts = air[k, 3] * command
        slope = twin.slope(s, current, air[k, :3], noise[k])
        given = pilot.command if p.control.inputs == "set_points" else command
        alpha = twin.angular_acceleration(s, slope)
        rows.append([s.p, s.v, s.R, twin.rates(s), twin.speeds(s), current, volts, given, slope[1], alpha])
        s, current = twin.step(s, current, volts, air[k, :3], noise[k], h)
    names = ("position", "velocity", "R_world_body", "rates", "rotor_speed", "current", "voltage", "command")
    names += ("acceleration", "angular_acceleration")
    return {name: np.array(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)}
