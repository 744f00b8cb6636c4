"""A flight without its motion: what would be recorded of a vehicle that hovers where it was."""

from __future__ import annotations

import numpy as np

from etude.types import Log
from etude_quadrotor.channels import SPECIFIC_FORCE
from etude_quadrotor.vehicle import GRAVITY

STILL = ("rates", "angular_acceleration", "body_velocity", "body_acceleration")


def hovering(log: Log) -> Log:
    """The log level and at rest at each altitude; what it lacks it still lacks."""
    weight = np.tile([0.0, 0.0, GRAVITY], (len(log), 1))
    still = log.put(SPECIFIC_FORCE, weight)
    for name in STILL:
        if name in log:
            still = still.put(log.channels[name], np.zeros_like(log[name]))
    return still
