"""Broken sensors of a simulated robot: of a command, in its log; an encoder with an offset, in the loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from etude.protocols import Trajectory
from etude.types import Array, Log, Motion

OFFSET, GAIN, ENCODER, FROZEN_S = 0.15, 1.4, 0.1, 20.0
"""Part of the command's range; times; rad; s at which a sensor gets stuck."""
FAULTS = ("offset", "gain", "encoder", "stuck")


@dataclass(frozen=True, eq=False)
class Shifted:
    """A motion that an encoder with an offset makes of another: what is measured follows the plan."""

    once: Trajectory
    shift: Array

    @property
    def duration(self) -> float:
        return self.once.duration

    def motion(self, t: Array, orders: int = 3) -> Motion:
        shifted = self.once.motion(t, orders).orders.copy()
        shifted[0] -= self.shift
        return Motion(t, shifted)


def broken(
    robot: Any, motion: Trajectory, rng: np.random.Generator, fault: str, joint: int, limit: Array
) -> Log:
    """The log of a run in which a sensor of that joint is broken: one of `FAULTS`.

    Args:
        limit: (J,) of the commands.
    """
    if fault == "encoder":
        shift = ENCODER * (np.arange(len(limit)) == joint)
        log: Log = robot.run(Shifted(motion, shift), None, rng)
        for name in ("q", "q_des"):
            log = log.put(log.channels[name], log[name] + shift) if name in log else log
        return log
    log = robot.run(motion, None, rng)
    command = log["command"].copy()
    if fault == "offset":
        command[:, joint] += OFFSET * limit[joint]
    elif fault == "gain":
        command[:, joint] *= GAIN
    else:
        after = log.t >= FROZEN_S
        command[after, joint] = command[np.argmax(after), joint]
    return log.put(log.channels["command"], command)
