"""The learned command along a trajectory, gravity apart: what a motion will ask of the motors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from etude.protocols import Model, Trajectory
from etude.types import Array


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
    count = math.floor(trajectory.duration * rate + 1e-9) + 1
    t = np.minimum(np.arange(count) / rate, trajectory.duration)
    log = model.inputs.states(trajectory.motion(t, model.inputs.orders))
    mean, variance = model.predict(log)
    return Effort(t, mean, np.sqrt(variance), model.static(log))
