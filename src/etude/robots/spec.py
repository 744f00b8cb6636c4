"""RobotSpec: what a campaign has to know of a robot. Axes by name, SI units, limits, rate."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from etude.robots.flight_spec import FlightSpec

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Axis:
    """One actuated joint and its limits.

    Attributes:
        name: the joint's name, as in logs and in the URDF or MJCF.
        lower, upper: position limits, rad (m for a sliding joint).
        velocity: largest |qd|, rad/s (m/s).
        acceleration: largest |qdd|, rad/s^2 (m/s^2).
        command: largest |tau| in the robot's command unit.
    """

    name: str
    lower: float
    upper: float
    velocity: float
    acceleration: float
    command: float


@dataclass(frozen=True)
class RobotSpec:
    """A robot as its owner describes it, one TOML file per robot (see `robots.toml_file`).

    Attributes:
        name: short name.
        axes: the actuated joints, in the order of every array's columns.
        command_unit: unit of the learned output: "N m", "N", "A", "V" or "pwm".
        rate: logging and control rate, Hz.
        model_file: URDF or MJCF with the rigid-body model, or None.
        plant: name of the simulated plant that stands in for the robot, or None.
        flight: what else is to know of a flying vehicle, whose axes are x, y, z; None for a robot of joints.
    """

    name: str
    axes: tuple[Axis, ...]
    command_unit: str
    rate: float
    model_file: Path | None = None
    plant: str | None = None
    flight: FlightSpec | None = None

    @property
    def dof(self) -> int:
        return len(self.axes)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(axis.name for axis in self.axes)

    @property
    def lower(self) -> Array:
        return np.array([axis.lower for axis in self.axes])

    @property
    def upper(self) -> Array:
        return np.array([axis.upper for axis in self.axes])

    @property
    def velocity(self) -> Array:
        return np.array([axis.velocity for axis in self.axes])

    @property
    def acceleration(self) -> Array:
        return np.array([axis.acceleration for axis in self.axes])

    @property
    def command(self) -> Array:
        """Largest command of each output; of a vehicle, how far it reaches from the middle of its range."""
        if self.flight is not None:
            lower, upper = np.array(self.flight.command_lower), np.array(self.flight.command_upper)
            return np.asarray(0.5 * (upper - lower))
        return np.array([axis.command for axis in self.axes])

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the learned outputs: the joints', or a vehicle's commands."""
        return self.names if self.flight is None else self.flight.command_names
