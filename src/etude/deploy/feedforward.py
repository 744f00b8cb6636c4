"""Feedforward along a trajectory: the expected command, with and without gravity."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from etude._runtime.rounding import whole_down
from etude.abilities import SupportsAccelerations
from etude.errors import UsageError
from etude.limits.motion_limits import TiltLimit
from etude.protocols import Limit, Model, Trajectory
from etude.types import Array, Mask

FORCES = ("N m", "N")
"""Units of commands that are allowed in a field named effort."""
ACCELERATION = 2
"""Index of the acceleration among the derivative orders."""
ROUNDING, HALVINGS = 1e-5, 40
"""Fraction of a tilt limit reserved for single precision, and bisections that find the usable fraction."""


@dataclass(frozen=True, eq=False)
class MotionWithCommands:
    """A motion with its commands, as input of exporters.

    Attributes:
        trajectory: the motion.
        command: t (T,) s -> (T, J) in the robot's command unit; None: no commands.
        acceleration: t (T,) s -> (T, k) set-points of the feedback in place of the motion's acceleration: the
            sum of this and the model's addition, such as drag; None: the motion's own. See
            `abilities.SupportsAccelerations`.
        tilt: rad from the vertical that commanded accelerations may ask of a thrust; inf: any.
    """

    trajectory: Trajectory
    command: Callable[[Array], Array] | None = None
    acceleration: Callable[[Array], Array] | None = None
    tilt: float = math.inf


def with_commands(trajectory: Trajectory, model: Model) -> MotionWithCommands:
    """The trajectory with the model's mean command for perfect tracking."""

    def command(t: Array) -> Array:
        states = model.inputs.states(trajectory.motion(t, model.inputs.orders))
        return np.asarray(model.predict(states)[0])

    return MotionWithCommands(trajectory, command)


def with_accelerations(
    what: Trajectory | MotionWithCommands, controller: Any, orders: int
) -> MotionWithCommands:
    """The motion with the accelerations that a controller passes to the feedback (`SupportsAccelerations`).

    Args:
        controller: any; without that capability, or without additions, the motion's own accelerations remain.
        orders: number of derivative orders that the model's inputs need.

    Raises:
        UnsafeTrajectoryError: the motion is singular, see `flat_motion` of vehicles.
    """
    commanded = what if isinstance(what, MotionWithCommands) else MotionWithCommands(what)
    motion = commanded.trajectory
    if not isinstance(controller, SupportsAccelerations):
        return commanded
    setpoint = controller.accelerations
    if setpoint(motion.motion(np.zeros(1), orders)) is None:
        return commanded
    return replace(commanded, acceleration=lambda t: np.asarray(setpoint(motion.motion(t, orders))))


def within_tilt(what: MotionWithCommands, limits: Sequence[Limit]) -> MotionWithCommands:
    """The same, with the model's additions to accelerations reduced so that they keep the limits of the tilt:
    the commanded accelerations must keep them like the motion itself.
    """
    tilts = [limit for limit in limits if isinstance(limit, TiltLimit)]
    if not tilts:
        return what
    limit = min(tilts, key=lambda tilt: tilt.angle)
    what = replace(what, tilt=limit.angle * (1.0 - ROUNDING))
    return _between(what, lambda planned, setpoint: clipped_to_tilt(planned, setpoint, limit))


def with_acceleration_share(what: MotionWithCommands, part: float) -> MotionWithCommands:
    """The same, with that fraction of the model's additions to accelerations."""
    return _between(what, lambda planned, setpoint: planned + part * (setpoint - planned))


def _between(what: MotionWithCommands, chosen: Callable[[Array, Array], Array]) -> MotionWithCommands:
    """The motion with accelerations (T, k) chosen from its own and from those with the model's additions."""
    setpoint, motion = what.acceleration, what.trajectory
    if setpoint is None:
        return what

    def held(t: Array) -> Array:
        planned = motion.motion(np.minimum(t, motion.duration), ACCELERATION + 1).orders[ACCELERATION]
        return chosen(planned, setpoint(t))

    return replace(what, acceleration=held)


def clipped_to_tilt(planned: Array, setpoint: Array, limit: TiltLimit) -> Array:
    """(T, 3) accelerations from `planned` towards `setpoint`, as far as the thrust's tilt keeps the limit.

    Found by bisection, since the allowed tilts are a cone, which a line leaves once.
    """
    angle = limit.angle * (1.0 - ROUNDING)

    def inside(part: Array) -> Mask:
        return np.asarray(limit.of_acceleration(planned + part[:, None] * (setpoint - planned)) <= angle)

    low, high = np.zeros(len(planned)), np.ones(len(planned))
    low[inside(high)] = 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        within = inside(middle)
        low, high = np.where(within, middle, low), np.where(within, high, middle)
    return np.asarray(planned + low[:, None] * (setpoint - planned))


def motion_and_command(
    what: Trajectory | MotionWithCommands,
) -> tuple[Trajectory, Callable[[Array], Array] | None]:
    """The motion, and its command if there is one."""
    return (what.trajectory, what.command) if isinstance(what, MotionWithCommands) else (what, None)


def require_forces(unit: str, robot: str, next_step: str) -> None:
    """UsageError unless commands in that unit may stand in a field named effort."""
    if unit not in FORCES:
        raise UsageError(
            f"commands of {robot!r} are in {unit or 'no force'}, an effort is in N m or N",
            next_step=next_step,
        )


@dataclass(frozen=True, eq=False)
class Effort:
    """Predicted commands along a trajectory, in the robot's own unit.

    Attributes:
        t: (T,) s.
        command: (T, J) mean command for perfect tracking.
        deviation: (T, J) its standard deviation, noise and calibration included.
        static: (T, J) the part that holds the robot at rest in each pose.
    """

    t: Array
    command: Array
    deviation: Array
    static: Array

    @property
    def moving(self) -> Array:
        """(T, J) the part due to motion."""
        return self.command - self.static

    @property
    def largest(self) -> Array:
        """(J,) largest |command|."""
        return np.asarray(np.abs(self.command).max(axis=0))


def effort(trajectory: Trajectory, model: Model, rate: float) -> Effort:
    """The model's prediction along the plan of `trajectory` at `rate` Hz."""
    count = whole_down(trajectory.duration * rate) + 1
    t = np.minimum(np.arange(count) / rate, trajectory.duration)
    log = model.inputs.states(trajectory.motion(t, model.inputs.orders))
    mean, variance = model.predict(log)
    return Effort(t, mean, np.sqrt(variance), model.static(log))
