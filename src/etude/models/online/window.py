"""The last second of measurements, smoothed and differentiated at its middle: samples to learn on line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError

Array = NDArray[np.float64]

ORDER = 3
"""Of the polynomial: the least with which velocity and command both are free of the motion's curvature."""
LARGEST_STEP = 1.5
"""Periods between two measurements beyond which the window starts anew."""


@dataclass(frozen=True, eq=False)
class MotionSample:
    """One instant: t in s; q, qd, qdd and the command tau, (dof,) each, smoothed alike."""

    t: float
    q: Array
    qd: Array
    qdd: Array
    tau: Array


def polynomial_weights(count: int, period: float, order: int = ORDER) -> Array:
    """(3, count) weights of value, first and second derivative at the middle of evenly spaced samples.

    Savitzky and Golay 1964: the least-squares polynomial through all of them. `count` is odd.
    """
    if count % 2 == 0 or count <= order + 1:
        raise UsageError(f"a window of order {order} needs an odd number above {order + 1}, not {count}")
    half = count // 2
    place = np.arange(-half, half + 1) / half  # in half windows, for the condition
    weights = np.linalg.pinv(np.vander(place, order + 1, increasing=True))[:3]
    unit = half * period
    return np.asarray(weights * np.array([1.0, 1.0 / unit, 2.0 / unit**2])[:, None])


class CentredWindow:
    """The newest measurements of `dof` joints; `middle` is half a window late.

    A measurement that is not finite or not later than the last is ignored and counted. After a pause, or a
    measurement ignored for its values, the window fills anew: its weights are for an even grid.

    Attributes:
        ignored: measurements that were not taken.
    """

    def __init__(self, dof: int, rate: float, seconds: float) -> None:
        self._count = 2 * round(0.5 * seconds * rate) + 1
        self._weights = polynomial_weights(self._count, 1.0 / rate)
        self._rows = np.empty((2 * self._count, 2 * dof))  # each row twice, so that the newest are contiguous
        self._dof, self._period = dof, 1.0 / rate
        self._filled, self._next, self._last = 0, 0, -np.inf
        self.ignored = 0

    def push(self, t: float, q: Array, tau: Array) -> None:
        """One measurement: time in s, position and command (dof,)."""
        row = np.concatenate([q, tau])
        finite = bool(np.isfinite(row).all())
        if not (finite and t > self._last):
            self.ignored += 1
            self._filled = self._filled if finite else 0
            return
        if t - self._last > LARGEST_STEP * self._period:
            self._filled = 0
        self._rows[self._next] = self._rows[self._next + self._count] = row
        self._next = (self._next + 1) % self._count
        self._filled, self._last = self._filled + 1, t

    def middle(self) -> MotionSample | None:
        """The sample in the middle of the window; None until it is full."""
        if self._filled < self._count:
            return None
        value, first, second = self._weights @ self._rows[self._next : self._next + self._count]
        d, t = self._dof, self._last - (self._count // 2) * self._period
        return MotionSample(t, value[:d], first[:d], second[:d], value[d:])
