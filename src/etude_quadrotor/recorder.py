"""Recorder columns of a flight as states of a model; missing states are left out."""

from __future__ import annotations

import numpy as np

from etude.logs.cleaning.filters import median_rate, smooth, uniform
from etude.types import Array, Log
from etude_quadrotor.channels import (
    ALTITUDE,
    ANGULAR_ACCELERATION,
    BODY_ACCELERATION,
    BODY_VELOCITY,
)
from etude_quadrotor.vehicle import GRAVITY

CUTOFF_SHARE = 0.125
"""Cutoff of the gyroscope's derivative, of the log's rate: noise grows with frequency, motors are slower."""
EVEN = 1e-10
"""Parts of a sampling step by which times may differ from a uniform grid."""


def with_states(log: Log) -> Log:
    """The log with every state that its columns determine; existing states stay unchanged.

    Args:
        log: on a uniform grid, with specific force and rates.
    """
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


def on_even_grid(log: Log) -> Log:
    """The log on a uniform grid: unchanged if its times are uniform, else its longest uniform part."""
    if len(log) < 2 or not np.isfinite(log.t).all():
        return log
    step = 1.0 / median_rate(log.t)
    even = log.t[0] + step * np.arange(len(log))
    return log if float(np.abs(log.t - even).max()) < EVEN * step else uniform(log)


def rotation(log: Log) -> Array | None:
    """R_world_body (T, 3, 3) from the orientation, or from roll, pitch, yaw; None without both."""
    from scipy.spatial.transform import Rotation

    if "orientation" in log:
        return np.asarray(Rotation.from_quat(log["orientation"][:, [1, 2, 3, 0]]).as_matrix())
    if "attitude" in log:
        return np.asarray(Rotation.from_euler("ZYX", log["attitude"][:, ::-1]).as_matrix())
    return None


def _velocity(log: Log) -> Array | None:
    """Velocity (T, 3) m/s in the world frame, measured or from the position."""
    if "velocity" in log:
        return log["velocity"]
    return _slope(log, "position") if "position" in log else None


def _slope(log: Log, name: str) -> Array:
    return smooth(log.t, log[name], CUTOFF_SHARE * median_rate(log.t)).first
