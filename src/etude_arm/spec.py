"""Specification of a robot of joints: `ArmSpec`. Axes by name, SI units, limits, rate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from etude.limits.robot_file_limits import LimitTable
from etude.types import Array, Channel
from etude_arm.clearance.surroundings import Surroundings
from etude_arm.loading.attachments import Attached, Mounting
from etude_arm.rehearsal.overlay import MotorTable, Simulate
from etude_arm.space.table import Cartesian

COMMAND = "command"
COMMAND_RATES = ("command_rate", "command_bend")
"""First and second derivative of the filtered command: by them samples show a small delay."""
PATH = ("q", "qd", "qdd")
PLAN = ("q_des", "qd_des", "qdd_des")
MEMORY = "friction_memory"
"""What friction remembers, in [-1, 1]: a state that samples carry, computed on the whole log."""
TURNING = "friction_turning"
"""The same for each of the distances over which friction may turn round in identified physics."""
FRICTION = "friction_speed"
"""v0 over which friction turns over, rad/s or m/s: on every sample, where the logs determine it."""
RIPPLES, FIRST_WAVE = 6, 2
"""Waves of a hinge's position, and the periods a turn of the first: one period is what gravity has."""
PRESLIDING_DISTANCES = (0.0001, 0.0005, 0.001, 0.002, 0.004, 0.008)
"""rad (a tenth of it in m for a slide): those distances. Gears give by some mrad before they slip; the
first stands for friction that turns round at once."""
FORCES = ("N m", "N")
"""Command units that inertial parameters predict by themselves."""
ORDERS = 3
"""Position, velocity and acceleration: what an inverse dynamics model looks at."""


@dataclass(frozen=True)
class Envelope:
    """Velocity envelope of one joint: towards `upper`, |qd| <= offset + sqrt(slope (upper - q)); alike
    towards `lower`.

    Attributes:
        offset: rad/s (m/s), negative if the joint must stop before the end.
        slope: rad/s^2 (m/s^2), twice the available deceleration.
        lower, upper: rad (m), ends in these formulas; they may lie beyond the joint's limits.
    """

    offset: float
    slope: float
    lower: float
    upper: float


@dataclass(frozen=True)
class Axis:
    """One actuated joint and its limits.

    Attributes:
        name: as in logs and in the URDF or MJCF.
        lower, upper: position limits, rad (m for a slide).
        velocity: largest |qd|, rad/s (m/s).
        acceleration: largest |qdd|, rad/s^2 (m/s^2).
        command: largest |command| in the robot's command unit.
        unit: of the position: "rad", or "m" for a slide.
        jerk: largest |qddd|, rad/s^3 (m/s^3); None without such a limit.
        torque: largest |command| of a planned motion, if smaller than that of the drive.
        torque_rate: largest rate of a planned command, command units per s; None without such a limit.
        envelope: velocity limit near the ends of the range; None: constant.
    """

    name: str
    lower: float
    upper: float
    velocity: float
    acceleration: float
    command: float
    unit: Literal["rad", "m"] = "rad"
    jerk: float | None = None
    torque: float | None = None
    torque_rate: float | None = None
    envelope: Envelope | None = None


@dataclass(frozen=True)
class Gains:
    """Gains of the robot's own feedback, if known.

    Attributes:
        kp: (J,) command units per rad (m). At a constant error e, the whole command is kp e.
    """

    kp: tuple[float, ...]


@dataclass(frozen=True)
class ArmSpec:
    """A robot as its owner describes it, one TOML file per robot (see `robot_file`).

    Attributes:
        name: short name.
        axes: actuated joints, in the order of every array's columns.
        command_unit: of the learned output: "N m", "N", "A", "V" or "pwm"; see `command_units`.
        rate: of logs and control, Hz.
        model_file: URDF or MJCF with the rigid-body model, or None.
        plant: name of the simulated plant that replaces the robot, or None.
        held: positions of the model file's other joints, rad or m.
        mounting: of the model file's base in the world; None: as in the file.
        tool, payload: load beyond the model file, or None.
        around: surroundings, and distances to keep from them and from the robot itself.
        cartesian: limits of speed and place in space; None without them.
        simulate, motors: of the simulated robot from the model file, without a plant.
        gains: of its feedback; None if unknown.
        confirm: assumptions, one sentence each, until a person confirms them.
        limits: the owner's own.
    """

    name: str
    axes: tuple[Axis, ...]
    command_unit: str
    rate: float
    model_file: Path | None = None
    plant: str | None = None
    held: Mapping[str, float] = field(default_factory=dict)
    mounting: Mounting | None = None
    tool: Attached | None = None
    payload: Attached | None = None
    around: Surroundings = field(default_factory=Surroundings)
    cartesian: Cartesian | None = None
    simulate: Simulate | None = None
    motors: tuple[MotorTable, ...] = ()
    gains: Gains | None = None
    confirm: tuple[str, ...] = ()
    limits: tuple[LimitTable, ...] = ()

    def agreed(self) -> ArmSpec:
        """The robot without open assumptions."""
        return replace(self, confirm=())

    @property
    def dof(self) -> int:
        return len(self.axes)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(axis.name for axis in self.axes)

    @property
    def joint_tables(self) -> tuple[dict[str, Any], ...]:
        """The file's values of each joint, by key."""
        return tuple(asdict(axis) for axis in self.axes)

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
    def jerk(self) -> Array:
        """Jerk limits (J,); infinite without a limit."""
        return np.array([math.inf if axis.jerk is None else axis.jerk for axis in self.axes])

    @property
    def command(self) -> Array:
        """Largest command of each joint."""
        return np.array([axis.command for axis in self.axes])

    @property
    def torque(self) -> Array:
        """Largest planned commands (J,); infinite if only the drive limits them."""
        return np.array([math.inf if axis.torque is None else axis.torque for axis in self.axes])

    @property
    def torque_rate(self) -> Array:
        """Largest rates of planned commands (J,), per s; infinite without a limit."""
        return np.array([math.inf if axis.torque_rate is None else axis.torque_rate for axis in self.axes])

    @property
    def command_units(self) -> tuple[str, ...]:
        """Units (J,) of the commands: forces of slides in N, torques of hinges in N m."""
        forces = {"rad": "N m", "m": "N"}
        return tuple(forces[a.unit] if self.command_unit in FORCES else self.command_unit for a in self.axes)

    def presliding(self, hinge: float) -> Array:
        """Presliding distance: `hinge` rad, a tenth of it in m for a slide."""
        return np.array([hinge if axis.unit == "rad" else 0.1 * hinge for axis in self.axes])

    def presliding_distances(self) -> Array:
        """`PRESLIDING_DISTANCES` (W, J) of each joint, rad or m."""
        return np.array([self.presliding(distance) for distance in PRESLIDING_DISTANCES])

    def memory(self) -> Channel:
        """Channel of the friction state."""
        return Channel(MEMORY, self.names, ("1",) * self.dof)

    def friction(self) -> Channel:
        """Channel of the friction velocity v0, if logs give it."""
        return Channel(FRICTION, self.names, tuple(f"{axis.unit}/s" for axis in self.axes))

    def turning(self) -> Channel:
        """Channel of the friction states for `PRESLIDING_DISTANCES`: all joints for the first distance, then
        the next.
        """
        parts = tuple(
            f"{name} within {distance:g}" for distance in PRESLIDING_DISTANCES for name in self.names
        )
        return Channel(TURNING, parts, ("1",) * len(parts))

    def channels(self) -> tuple[Channel, ...]:
        """Channels that a log of this robot may have; only positions and commands are required."""
        return (*self.motion(PATH, "state"), *self.motion(PLAN, "plan"), *self._commands(), self._truth())

    def motion(self, names: tuple[str, ...], role: Literal["state", "plan"]) -> tuple[Channel, ...]:
        """Channels of the joints' position, velocity and acceleration under these names."""
        reach = (np.maximum(np.abs(self.lower), np.abs(self.upper)), self.velocity, self.acceleration)
        return tuple(
            Channel(
                name,
                self.names,
                tuple(axis.unit + ("", "/s", "/s^2")[order] for axis in self.axes),
                role,
                required=name == PATH[0],
                derivative_of=names[order - 1] if order else "",
                reach=tuple(reach[order].tolist()),
            )
            for order, name in enumerate(names)
        )

    def _commands(self) -> tuple[Channel, ...]:
        units = self.command_units
        reach = tuple(self.command.tolist())
        return (
            Channel(COMMAND, self.names, units, "command", required=True, acts_on=PATH[0], reach=reach),
            Channel("command_ff", self.names, units, "aside"),
            Channel("command_fb", self.names, units, "aside"),
        )

    def _truth(self) -> Channel:
        return Channel("q_true", self.names, tuple(axis.unit for axis in self.axes), "truth")
