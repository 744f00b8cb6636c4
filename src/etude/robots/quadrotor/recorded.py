"""From what a flight recorder writes to the states that a model looks at; what nothing tells stays out."""

from __future__ import annotations

import numpy as np

from etude.contracts import Array, Log
from etude.logs.steps import median_rate, smooth
from etude.robots.quadrotor.channels import (
    ALTITUDE,
    ANGULAR_ACCELERATION,
    BODY_ACCELERATION,
    BODY_VELOCITY,
    SPECIFIC_FORCE,
)
from etude.robots.quadrotor.vehicle import GRAVITY

CUTOFF_SHARE = 0.125
"""Cutoff of the gyroscope's derivative, of the log's rate: noise grows with frequency, motors are slower."""
IN_G = (0.5, 2.0)
"""In flight the thrust carries the weight: an accelerometer whose mean length is so much reads parts of g."""


def with_states(log: Log) -> Log:
    """The log with every state that it tells; those that it has already stay as they are.

    Args:
        log: on a uniform grid, with specific force and rates.
    """
    log = in_si(log)
    if "altitude" not in log and "position" in log:
        log = log.put(ALTITUDE, log["position"][:, 2:])
    if "angular_acceleration" not in log:
        log = log.put(ANGULAR_ACCELERATION, _slope(log, "rates"))
    if "body_velocity" in log and "body_acceleration" in log:
        return log
    R_world_body, velocity = rotation(log), _velocity(log)
    if R_world_body is None:
        return log
    if velocity is not None and "body_velocity" not in log:
        log = log.put(BODY_VELOCITY, np.einsum("tji,tj->ti", R_world_body, velocity))
    if "body_acceleration" not in log:
        # gravity seen from the body is the last row of R_world_body
        log = log.put(BODY_ACCELERATION, log["specific_force"] - GRAVITY * R_world_body[:, 2, :])
    return log


def in_si(log: Log) -> Log:
    """The log with accelerations in m/s^2: parts of g are known by gravity."""
    if not IN_G[0] < accelerometer(log) < IN_G[1]:
        return log
    converted = log.put(SPECIFIC_FORCE, GRAVITY * log["specific_force"])
    return converted.repaired("Accelerations were converted from g.")


def accelerometer(log: Log) -> float:
    """Its usual length, m/s^2: in flight about g."""
    return float(np.median(np.linalg.norm(log["specific_force"], axis=1)))


def rotation(log: Log) -> Array | None:
    """R_world_body (T, 3, 3) of the orientation, or of roll, pitch, yaw; None if the log has neither."""
    from scipy.spatial.transform import Rotation

    if "orientation" in log:
        return np.asarray(Rotation.from_quat(log["orientation"][:, [1, 2, 3, 0]]).as_matrix())
    if "attitude" in log:
        return np.asarray(Rotation.from_euler("ZYX", log["attitude"][:, ::-1]).as_matrix())
    return None


def _velocity(log: Log) -> Array | None:
    """(T, 3) m/s in the world frame, measured or of the position."""
    if "velocity" in log:
        return log["velocity"]
    return _slope(log, "position") if "position" in log else None


def _slope(log: Log, name: str) -> Array:
    return smooth(log.t, log[name], CUTOFF_SHARE * median_rate(log.t)).first
