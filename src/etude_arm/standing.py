"""When a joint stands, in absolute units.

A speed relative to the log's own top one makes every sample of a joint that is only
held a moving one: its command then teaches what friction held, as if it were dynamics.
"""

from __future__ import annotations

import math

import numpy as np

from etude.logs.cleaning.filters import slower
from etude.types import Array, Mask
from etude_arm.spec import ArmSpec

PLAY = 4.0
"""Half width of the play in deviations of the position's noise. With noise at rest for a minute at 100 Hz the
memory keeps 95 % of itself; with three deviations 88 %, with two 20 %."""
FOURTH_DIFFERENCE = 0.6745 * math.sqrt(70.0)
"""Median of |fourth difference| of independent normal numbers, in their deviations. Of lower order, it is
the acceleration of a fast robot that is seen, and not the noise."""


def resolution(q: Array, quantum: tuple[float, ...] = ()) -> Array:
    """(J,) r: the half width that noise and steps of a recorded position q (T, J) do not leave, rad or m.

    The encoder's step is `quantum` where it is known, else the least difference between two positions that
    were recorded. Noise of less than that is none.
    """
    if len(q) < 5:
        return np.zeros(q.shape[1])
    noise = np.median(np.abs(np.diff(q, 4, axis=0)), axis=0) / FOURTH_DIFFERENCE
    step = np.array(quantum) if quantum else _step(q)
    return np.asarray(np.maximum(PLAY * noise, step))


def _step(q: Array) -> Array:
    """(J,) least difference of neighbouring rows that is not rounding; 0 if a joint never changes."""
    size = np.abs(np.diff(q, axis=0))
    rounding = 1e-9 * np.maximum(np.abs(q).max(axis=0), 1.0)
    return np.where((size > rounding).any(axis=0), np.where(size > rounding, size, np.inf).min(axis=0), 0.0)


def standing(speed: Array, spec: ArmSpec, fraction: float, play: Array, cutoff_hz: float) -> Mask:
    """(T, J) where a joint stands: slower than a part of its top speed, or than what its encoder resolves.

    Motion of amplitude `play` (J,) at the filter's cutoff cannot be told from none, so its speed is the least
    that is motion, however slow the log is as a whole; it is never more than that part of the velocity limit.
    """
    relative = slower(speed, spec.velocity, fraction)
    if not math.isfinite(cutoff_hz):
        return relative
    least = np.minimum(2.0 * math.pi * cutoff_hz * play, fraction * spec.velocity)
    return np.asarray(relative | (np.abs(speed) < least))
