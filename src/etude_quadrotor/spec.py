"""Specification of a multirotor with flat dynamics, and of its workspace: `QuadrotorSpec`."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from etude.limits.robot_file_limits import LimitTable
from etude_quadrotor.vehicle import Rotor, Vehicle


@dataclass(frozen=True)
class QuadrotorSpec:
    """A vehicle as its owner describes it. World frame: z up; SI units.

    Attributes:
        name: short name.
        lower, upper: corners of the box of the vehicle's centre, m.
        speed: largest |v|, m/s.
        command_names: the n >= 4 learned outputs, for example the motors.
        command_unit: "V", or "1" for normalised set-points.
        command_lower, command_upper: limits of each command, in that unit.
        rate: of the samples for a model, Hz; logs may be faster.
        radius: of a cylinder about the z axis inside the box, m; None without one.
        tilt: largest angle of the thrust from the vertical, rad; None without limit.
        thrust: least and largest thrust per mass, m/s^2; None without limits.
        margin: for the tracking error at the side walls of box and cylinder, m.
        vertical_margin: for the tracking error at floor and ceiling, m; None: as `margin`.
        ground: height of its centre on the ground, m; None: the bottom of the box.
        climb, descent: largest vertical speeds of its autopilot, m/s, which clips faster set-points and lags.
            The values are PX4's own, MPC_Z_VEL_MAX_UP and MPC_Z_VEL_MAX_DN. Without effect on simulated
            vehicles.
        attitude_gain, velocity_damping: P of its autopilot's attitude, 1/s, and D of its horizontal velocity.
            The values are PX4's own, MC_ROLL_P and MPC_XY_VEL_D_ACC; acceleration set-points allow for them.
        damping_stated: the damping is not assumed: limits of the tilt need not hold without it.
        vehicle: nominal body and motors, for the analytic inverse model; None if unknown.
        plant: name of the simulated vehicle that replaces the real one, or None.
        rotors: place and spin of each, in the order of the commands; (): four in an X, or unknown.
        thrust_curve: THR_MDL_FAC of PX4 in the flights; commands in logs are before it.
        limits: the owner's own.
    """

    name: str
    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    speed: float
    command_names: tuple[str, ...]
    command_unit: str
    command_lower: tuple[float, ...]
    command_upper: tuple[float, ...]
    rate: float
    radius: float | None = None
    tilt: float | None = None
    thrust: tuple[float, float] | None = None
    margin: float = 0.5
    vertical_margin: float | None = None
    ground: float | None = None
    climb: float = 3.0
    descent: float = 1.5
    attitude_gain: float = 6.5
    velocity_damping: float = 0.2
    damping_stated: bool = False
    vehicle: Vehicle | None = None
    plant: str | None = None
    rotors: tuple[Rotor, ...] = ()
    thrust_curve: float = 0.0
    limits: tuple[LimitTable, ...] = ()

    @property
    def margins(self) -> tuple[float, float, float]:
        """Tracking margins along x, y and z, m."""
        vertical = self.margin if self.vertical_margin is None else self.vertical_margin
        return self.margin, self.margin, vertical

    @property
    def floor(self) -> float:
        """Height of its centre on the ground, m."""
        return self.lower[2] if self.ground is None else self.ground

    @property
    def table_rate(self) -> float:
        """Rate of a table of set-points, Hz: that of an autopilot's input."""
        return 50.0

    @property
    def reach(self) -> NDArray[np.float64]:
        """Half range (n,) of each command, in its unit."""
        return np.asarray(0.5 * (np.array(self.command_upper) - np.array(self.command_lower)))

    @property
    def airframe(self) -> Vehicle | None:
        """The vehicle with the positions of its rotors; None without description."""
        if self.vehicle is None or not self.rotors:
            return self.vehicle
        return replace(self.vehicle, layout=self.rotors)

    @property
    def body(self) -> Vehicle | None:
        """The vehicle whose motors explain the commands; None without description, or for set-points."""
        return self.airframe if self.command_unit == "V" else None
