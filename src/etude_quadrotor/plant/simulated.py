"""SimulatedVehicle: a quadrotor that can be flown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError
from etude_quadrotor.plant import core
from etude_quadrotor.plant.constants import control, true_body
from etude_quadrotor.plant.disturbance import Disturbance
from etude_quadrotor.plant.flight import REASONS, Ending, Flight, rotation
from etude_quadrotor.plant.parameters import FlightParameters
from etude_quadrotor.plant.plan import FlightPlan, check_plan
from etude_quadrotor.plant.trim import trim
from etude_quadrotor.spec import QuadrotorSpec
from etude_quadrotor.vehicle import GRAVITY, Vehicle

Array = NDArray[np.float64]
Start = Literal["hover", "moving"]

MOTORS = ("front_right", "back_right", "back_left", "front_left")
SET_POINTS = ("roll", "pitch", "yaw_rate", "thrust")
NOWHERE = np.array([-np.inf] * 3 + [np.inf] * 4)


@dataclass(frozen=True)
class Commands:
    """Names, unit and limits of the four commands."""

    names: tuple[str, str, str, str]
    unit: str
    lower: tuple[float, ...]
    upper: tuple[float, ...]


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
        return Commands(SET_POINTS, "1", (-1.0, -1.0, -1.0, 0.0), (1.0,) * 4)

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
        told, count = self.commands, len(trace)
        command = trace[:, 25:29]
        at_limit = (command <= np.array(told.lower)) | (command >= np.array(told.upper))
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
            command_names=told.names,
            command_unit=told.unit,
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
