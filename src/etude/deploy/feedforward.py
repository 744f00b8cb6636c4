"""Feedforward along a trajectory: the expected command, with and without gravity."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from etude._runtime.rounding import whole_down
from etude.abilities import SupportsAccelerations
from etude.errors import UsageError
from etude.limits.convex_limits import TiltLimit
from etude.protocols import Limit, Model, Trajectory
from etude.types import Array, Mask

FORCES = ("N m", "N")
"""Units of commands that a field named effort may hold."""
ACCELERATION = 2
"""The order of a motion."""
ROUNDING, HALVINGS = 1e-5, 40
"""Part of a tilt limit left to single precision; of finding how much of what was learned it allows."""


@dataclass(frozen=True, eq=False)
class Commanded:
    """What exporters take where the command goes along with the motion.

    Attributes:
        trajectory: the motion.
        command: t (T,) s -> (T, J) in the robot's command unit; None: none goes along.
        acceleration: t (T,) s -> (T, k) what a feedback is told in place of the motion's own acceleration:
            that and what the model adds, such as drag; None: the motion's own. See
            `abilities.SupportsAccelerations`.
    """

    trajectory: Trajectory
    command: Callable[[Array], Array] | None = None
    acceleration: Callable[[Array], Array] | None = None


def commanded(trajectory: Trajectory, model: Model) -> Commanded:
    """The trajectory and the mean of the model's command of a perfect run."""

    def command(t: Array) -> Array:
        states = model.inputs.states(trajectory.motion(t, model.inputs.orders))
        return np.asarray(model.predict(states)[0])

    return Commanded(trajectory, command)


def accelerated(what: Trajectory | Commanded, controller: Any, orders: int) -> Commanded:
    """With the accelerations that a controller would tell the feedback (`SupportsAccelerations`).

    Args:
        controller: any; without that capability, and where it adds nothing, the motion's own remain.
        orders: of the motion that the model's inputs need.

    Raises:
        UnsafeTrajectoryError: the motion is singular, see `flat_motion` of vehicles.
    """
    own = what if isinstance(what, Commanded) else Commanded(what)
    motion = own.trajectory
    if not isinstance(controller, SupportsAccelerations):
        return own
    setpoint = controller.accelerations
    if setpoint(motion.motion(np.zeros(1), orders)) is None:
        return own
    return replace(own, acceleration=lambda t: np.asarray(setpoint(motion.motion(t, orders))))


def within_tilt(what: Commanded, limits: Sequence[Limit]) -> Commanded:
    """The same, with as much of what the model adds to accelerations as limits of the tilt allow: what is
    commanded has to hold them, as the motion does.
    """
    tilts = [limit for limit in limits if isinstance(limit, TiltLimit)]
    if not tilts:
        return what
    limit = min(tilts, key=lambda own: own.angle)
    return _between(what, lambda own, setpoint: shortened(own, setpoint, limit))


def shared(what: Commanded, part: float) -> Commanded:
    """The same, with that part of what the model adds to accelerations."""
    return _between(what, lambda own, setpoint: own + part * (setpoint - own))


def _between(what: Commanded, chosen: Callable[[Array, Array], Array]) -> Commanded:
    """With accelerations (T, k) chosen of the motion's own and of those with what the model adds."""
    setpoint, motion = what.acceleration, what.trajectory
    if setpoint is None:
        return what

    def held(t: Array) -> Array:
        own = motion.motion(np.minimum(t, motion.duration), ACCELERATION + 1).orders[ACCELERATION]
        return chosen(own, setpoint(t))

    return replace(what, acceleration=held)


def shortened(own: Array, setpoint: Array, limit: TiltLimit) -> Array:
    """(T, 3) from own towards told, as far as the thrust's tilt stays within the limit. By halving: the tilts
    allowed are a cone, which a line leaves once.
    """
    angle = limit.angle * (1.0 - ROUNDING)

    def inside(part: Array) -> Mask:
        return np.asarray(limit.of_acceleration(own + part[:, None] * (setpoint - own)) <= angle)

    low, high = np.zeros(len(own)), np.ones(len(own))
    low[inside(high)] = 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        within = inside(middle)
        low, high = np.where(within, middle, low), np.where(within, high, middle)
    return np.asarray(own + low[:, None] * (setpoint - own))


def parted(what: Trajectory | Commanded) -> tuple[Trajectory, Callable[[Array], Array] | None]:
    """The motion, and its command if there is one."""
    return (what.trajectory, what.command) if isinstance(what, Commanded) else (what, None)


def require_forces(unit: str, robot: str, next_step: str) -> None:
    """UsageError unless commands in that unit may stand in a field named effort."""
    if unit not in FORCES:
        raise UsageError(
            f"commands of {robot!r} are in {unit or 'no force'}, an effort is in N m or N",
            next_step=next_step,
        )


@dataclass(frozen=True, eq=False)
class Effort:
    """What a model expects a trajectory to take; commands in the robot's own unit.

    Attributes:
        t: (T,) s.
        command: (T, J) mean of the command of a perfect run.
        deviation: (T, J) its standard deviation, noise and calibration included.
        static: (T, J) the part that holds the robot still in each pose.
    """

    t: Array
    command: Array
    deviation: Array
    static: Array

    @property
    def moving(self) -> Array:
        """(T, J) the part that is there because of motion."""
        return self.command - self.static

    @property
    def largest(self) -> Array:
        """(J,) largest |command|."""
        return np.asarray(np.abs(self.command).max(axis=0))


def effort(trajectory: Trajectory, model: Model, rate: float) -> Effort:
    """The model's answer along the plan of `trajectory` at `rate` Hz."""
    count = whole_down(trajectory.duration * rate) + 1
    t = np.minimum(np.arange(count) / rate, trajectory.duration)
    log = model.inputs.states(trajectory.motion(t, model.inputs.orders))
    mean, variance = model.predict(log)
    return Effort(t, mean, np.sqrt(variance), model.static(log))
