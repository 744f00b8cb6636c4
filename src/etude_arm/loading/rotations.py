"""Rotations by roll, pitch and yaw, as URDF writes them: about the fixed x, then y, then z."""

from __future__ import annotations

import math

import numpy as np

from etude.types import Array


def turn_of(roll: float, pitch: float, yaw: float) -> Array:
    """Rz(yaw) Ry(pitch) Rx(roll)."""
    (a, b, c), (x, y, z) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    return np.array(
        [
            [c * b, c * y * x - z * a, c * y * a + z * x],
            [z * b, z * y * x + c * a, z * y * a - c * x],
            [-y, b * x, b * a],
        ]
    )


def angles_of(turn: Array) -> tuple[float, float, float]:
    """Roll, pitch and yaw of a rotation; at a pitch of 90 degrees roll is set to 0."""
    pitch = math.atan2(-turn[2, 0], math.hypot(turn[0, 0], turn[1, 0]))
    # 1.4 µrad from 90 degrees: there only the difference of roll and yaw is known
    if abs(turn[2, 0]) > 1 - 1e-12:
        return 0.0, pitch, math.atan2(-turn[0, 1], turn[1, 1])
    return math.atan2(turn[2, 1], turn[2, 2]), pitch, math.atan2(turn[1, 0], turn[0, 0])
