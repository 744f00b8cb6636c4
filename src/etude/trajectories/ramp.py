"""Phase ramp: any series starts and ends at rest on its own path (maths of minimum-jerk time scaling)."""

from __future__ import annotations

import math

import numpy as np

from etude.types import Array

PEAK_RATE = 15.0 / 8.0
"""max S'(s) for S(s) = s^3 (10 - 15 s + 6 s^2)."""
PEAK_BEND = 10.0 / math.sqrt(3.0)
"""max |S''(s)|."""
PEAK_PRODUCT = 1.195
"""No less than max S(s) S'(s), 1.19482."""


def phase(t: Array, duration: float, ramp: float) -> tuple[Array, Array, Array, Array]:
    """Series time theta(t) and its first three derivatives; theta' = S(t/ramp), mirrored at the end.

    Args:
        t: (T,) s; times outside [0, duration] are held at the nearer end with zero rates.
        duration: s.
        ramp: length of each ramp in s, 0 <= 2 ramp <= duration; theta advances ramp/2 in each.

    Returns:
        theta in s, theta', theta'' in 1/s, theta''' in 1/s^2, each (T,).
    """
    t = np.asarray(t, dtype=float)
    inside = (t >= 0.0) & (t <= duration)
    held = np.clip(t, 0.0, duration)
    zero = np.zeros_like(held)
    if ramp == 0.0:
        return held, inside.astype(float), zero, zero
    from_end = held > 0.5 * duration
    run = np.where(from_end, duration - held, held)
    s = np.minimum(run / ramp, 1.0)
    area = np.where(s < 1.0, ramp * s**4 * (2.5 - 3.0 * s + s * s), run - 0.5 * ramp)
    theta = np.where(from_end, duration - ramp - area, area)
    rate = np.where(inside, s**3 * (10.0 - 15.0 * s + 6.0 * s * s), 0.0)
    side = np.where(from_end, -1.0, 1.0)
    second = side * 30.0 * (s * (1.0 - s)) ** 2 / ramp
    third = np.where(inside, 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / ramp**2, 0.0)
    return theta, rate, second, third
