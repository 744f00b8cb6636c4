"""SimulatedVehicle: a quadrotor in flight, with its trim, wind and a battery whose voltage sags."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError
from etude_quadrotor.plant import core
from etude_quadrotor.plant.core import SET_POINTS, VOLTAGES, Body, Control
from etude_quadrotor.plant.flight import REASONS, Ending, Flight, rotation
from etude_quadrotor.plant.flight_plan import FlightPlan, check_plan
from etude_quadrotor.plant.parameters import FlightParameters, load_flight_parameters
from etude_quadrotor.spec import QuadrotorSpec
from etude_quadrotor.vehicle import GRAVITY, SPINS, Vehicle

Array = NDArray[np.float64]
Start = Literal["hover", "moving"]

PLANTS = ("quadrotor", "quadrotor_rough", "pelican")
"""Names of the simulated vehicles: one file of parameters each."""
MOTORS = ("front_right", "back_right", "back_left", "front_left")
SET_POINT_NAMES = ("roll", "pitch", "yaw_rate", "thrust")
NOWHERE = np.array([-np.inf] * 3 + [np.inf] * 4)


@dataclass(frozen=True)
class Commands:
    """Names, unit and limits of the four commands."""

    names: tuple[str, str, str, str]
    unit: str
    lower: tuple[float, ...]
    upper: tuple[float, ...]


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


def true_body(p: FlightParameters) -> Body:
    """The true vehicle, about its true centre of mass."""
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
    vehicle_mode = VOLTAGES if c.inputs == "voltage" else SET_POINTS
    return Control(
        mode=vehicle_mode if mode is None else mode,
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


@dataclass(frozen=True)
class Disturbance:
    """Changes during one flight; t is counted from its start.

    Attributes:
        wind: constant, world frame, m/s.
        gust: added to the wind at the top of one pulse (1 - cos)/2 from `gust_start` that lasts
            `gust_duration`, s (the discrete gust of the certification rules).
        sag: share of the supply lost at once.
        sag_rate: share lost per second; the motors get at least a tenth of what is commanded.
    """

    wind: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gust: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gust_start: float = 0.0
    gust_duration: float = 1.0
    sag: float = 0.0
    sag_rate: float = 0.0

    def __post_init__(self) -> None:
        numbers = np.array(
            [*self.wind, *self.gust, self.gust_start, self.gust_duration, self.sag, self.sag_rate]
        )
        if not np.isfinite(numbers).all() or self.gust_duration <= 0.0 or not 0.0 <= self.sag < 1.0:
            raise UsageError(
                "the disturbance is impossible",
                where=str(self),
                next_step="Give finite numbers, a gust_duration above 0 and a sag in [0, 1).",
            )

    def over(self, t: Array) -> Array:
        """(T, 4) wind (world, m/s) and supply over its nominal value at times t (T,), s from the start."""
        phase = np.clip((t - self.gust_start) / self.gust_duration, 0.0, 1.0)
        pulse = 0.5 * (1.0 - np.cos(2.0 * np.pi * phase))
        wind = np.array(self.wind) + pulse[:, None] * np.array(self.gust)
        # a tenth of the nominal voltage: an empty battery ends a flight before, and the plant stays finite
        supply = np.clip(1.0 - self.sag - self.sag_rate * t, 0.1, None)
        return np.column_stack([wind, supply])


@dataclass(frozen=True)
class SimulatedVehicle:
    """A quadrotor with its controller.

    Attributes:
        name: of the vehicle.
        parameters: the truth.
        vehicle: the nominal body and motors, all that its owner and its controller know.
        noise: level of `parameters.noise` on the accelerations.
        rate: of physics and control, Hz.
    """

    name: str
    parameters: FlightParameters
    vehicle: Vehicle
    noise: str = "mid"
    rate: float = 1000.0

    @property
    def commands(self) -> Commands:
        """What its controller commands, and how far."""
        limit = self.vehicle.voltage_limit
        if self.parameters.control.inputs == "voltage":
            return Commands(MOTORS, "V", (0.0,) * 4, (limit,) * 4)
        return Commands(SET_POINT_NAMES, "1", (-1.0, -1.0, -1.0, 0.0), (1.0,) * 4)

    def fly(
        self,
        plan: FlightPlan,
        rng: np.random.Generator | None,
        start: Start = "hover",
        disturbance: Disturbance | None = None,
        room: QuadrotorSpec | None = None,
    ) -> Flight:
        """Follows the plan by the vehicle's own cascade and the plan's feedforwards.

        Args:
            plan: on the control grid.
            rng: source of the noise on both accelerations, one draw per tick; None for calm air.
            start: "hover", at rest in plan.position[0], in balance (the thesis); "moving", at the plan's
                velocity, tilted as its acceleration asks.
            disturbance: wind and battery that no model knows.
            room: the flight ends where the centre leaves this box or cylinder; None: only at the ground.

        Raises:
            UsageError: a plan off the grid, with NaN or of a wrong shape, that starts on the ground or
                outside the room; an unknown start or noise.
        """
        self._check(plan, start, room)
        y, current, total = self.start_state(plan, start)
        trace, why = core.fly(
            _reference(plan),
            _rows(plan.voltage_ff, len(plan), 4),
            (disturbance or Disturbance()).over(plan.t - plan.t[0]),
            self._noise(rng, len(plan)),
            y,
            current,
            total,
            1.0 / self.rate,
            true_body(self.parameters),
            control(self.parameters, self.rate),
            _walls(room),
            self.parameters.contact_height,
        )
        return self._flight(plan, start, trace, why)

    def _noise(self, rng: np.random.Generator | None, count: int) -> Array:
        linear, angular = self.parameters.noise[self.noise]
        if rng is None:
            return np.zeros((count, 6))
        return np.asarray(rng.standard_normal((count, 6)) * np.repeat([linear, angular], 3))

    def start_state(self, plan: FlightPlan, start: Start) -> tuple[Array, Array, Array]:
        """State, currents, and the integrals of the position error of a vehicle that has hovered here."""
        y, lift = np.zeros(17), np.array([0.0, 0.0, GRAVITY])
        if start == "moving":
            y[3:6] = plan.velocity[0]
            lift = lift + _first_acceleration(plan)
        begin = trim(self.parameters, float(plan.position[0, 2]), float(np.linalg.norm(lift)))
        y[:3], y[6:10], y[13:] = plan.position[0], _attitude(lift, begin.yaw), begin.speed
        return y, begin.current, begin.total

    def _flight(self, plan: FlightPlan, start: Start, trace: Array, why: int) -> Flight:
        commands, count = self.commands, len(trace)
        command = trace[:, 25:29]
        at_limit = (command <= np.array(commands.lower)) | (command >= np.array(commands.upper))
        return Flight(
            t=plan.t[:count],
            position=trace[:, :3],
            velocity=trace[:, 3:6],
            R_world_body=rotation(trace[:, 6:10]),
            rates=trace[:, 10:13],
            rotor_speed=trace[:, 13:17],
            current=trace[:, 17:21],
            voltage=trace[:, 21:25],
            command=command,
            acceleration=trace[:, 29:32],
            angular_acceleration=trace[:, 32:35],
            wind=trace[:, 35:38],
            supply=trace[:, 38],
            command_names=commands.names,
            command_unit=commands.unit,
            saturated=np.asarray(at_limit.any(axis=1)),
            source=f"simulated {self.name}, {start} start",
            ended=None if why == core.FLOWN else self._ending(trace, why),
        )

    def _ending(self, trace: Array, why: int) -> Ending:
        x, y, z = trace[-1, :3]
        return Ending(len(trace) / self.rate, (float(x), float(y), float(z)), REASONS[why])

    def _check(self, plan: FlightPlan, start: str, room: QuadrotorSpec | None) -> None:
        check_plan(plan, self.rate, self.name)
        if start not in ("hover", "moving"):
            raise UsageError(
                f"there is no start {start!r}", where=self.name, next_step="Choose hover or moving."
            )
        if self.noise not in self.parameters.noise:
            raise UsageError(
                f"there is no noise level {self.noise!r}",
                where=self.name,
                next_step=f"Choose one of: {', '.join(self.parameters.noise)}.",
            )
        y = np.zeros(17)
        y[:3] = plan.position[0]
        if core.ending(y, _walls(room), self.parameters.contact_height) != core.FLOWN:
            raise UsageError(
                "the plan starts on the ground or outside the room",
                where=f"{self.name}, {plan.position[0].round(3).tolist()} m",
                next_step="Start inside the box, above the ground.",
            )


def _reference(plan: FlightPlan) -> Array:
    return np.column_stack([plan.position, plan.velocity, _rows(plan.acceleration_ff, len(plan), 3)])


def _rows(rows: Array | None, count: int, columns: int) -> Array:
    return np.zeros((count, columns)) if rows is None else np.ascontiguousarray(rows, dtype=np.float64)


def _walls(room: QuadrotorSpec | None) -> Array:
    if room is None:
        return NOWHERE
    return np.array([*room.lower, *room.upper, np.inf if room.radius is None else room.radius])


def _first_acceleration(plan: FlightPlan) -> Array:
    if plan.acceleration_ff is not None:
        return np.asarray(plan.acceleration_ff[0])
    if len(plan) < 2:
        return np.zeros(3)
    return np.asarray((plan.velocity[1] - plan.velocity[0]) / (plan.t[1] - plan.t[0]))


def _attitude(force: Array, yaw: float) -> Array:
    """Quaternion: a turn by `yaw`, then the least rotation that points the body's z along `force`."""
    x, y, z = force / np.linalg.norm(force)
    cos, sin = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
    q = np.array([(1.0 + z) * cos, -y * cos + x * sin, x * cos + y * sin, (1.0 + z) * sin])
    return np.asarray(q / np.linalg.norm(q))


def simulated_vehicle(name: str, where: str = "") -> SimulatedVehicle:
    """The simulated vehicle `name`, one of PLANTS; another noise: `dataclasses.replace(v, noise=...)`.

    Raises:
        UsageError: unknown name; where: its place, for the message.
    """
    if name not in PLANTS:
        raise UsageError(
            f"there is no simulated vehicle {name!r}",
            where=where,
            next_step=f"Choose one of: {', '.join(PLANTS)}.",
        )
    parameters = load_flight_parameters(name)
    return SimulatedVehicle(name, parameters, parameters.nominal)
