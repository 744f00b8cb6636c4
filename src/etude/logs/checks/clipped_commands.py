"""Clipped commands: a command that stays at its extreme while the joint goes on.

Noisy numbers are never equal. A coarse sensor repeats a value where the command turns, at the extreme or
elsewhere. A command at the limit of the robot file is real saturation of the drive, and gives no finding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.types import Array, Mask

EQUAL = 1e-9  # of a command's range: within, two values are the same
LONGER = 3.0  # times the rows that any other value stands while the joint goes on
LEAST_ROWS, LEAST_SHARE = 10, 0.01  # of a log that stand at an extreme, in one joint and one direction
AT_LIMIT = 0.95  # of the limit: a drive that gives all it has
NOTHING = 0.2  # of a joint's largest command: an extreme below is a drive that does nothing there
MOVES = 0.02  # of a joint's fastest step, at least, while its command stands


@dataclass(frozen=True, eq=False)
class Clipped:
    """Joints whose commands are clipped.

    Attributes:
        joints: (J,) whether clipped. levels: (J,) clipped value, in the unit of the command; 0 for others.
        rows: (T,) whether any joint is clipped.
    """

    joints: Mask
    levels: Array
    rows: Mask


def clipped(q: Array, u: Array, limit: Array) -> Clipped | None:
    """Clipped joints, from positions and commands (T, J) and limits (J,) or infinity; None if none are."""
    clipping = Clipped(
        np.zeros(u.shape[1], dtype=np.bool_), np.zeros(u.shape[1]), np.zeros(len(u), dtype=np.bool_)
    )
    for j in range(u.shape[1]):
        for sign in (1.0, -1.0):
            flat = _flat(q[:, j], sign * u[:, j])
            level = float((sign * u[:, j]).max())
            few = flat.sum() < max(LEAST_ROWS, LEAST_SHARE * len(u))
            if few or level >= AT_LIMIT * limit[j] or level <= NOTHING * float(np.abs(u[:, j]).max()):
                continue
            clipping.joints[j], clipping.levels[j] = True, sign * level
            clipping.rows[:] |= flat
    return clipping if clipping.joints.any() else None


def _flat(q: Array, u: Array) -> Mask:
    """(T,) rows of long stretches at the largest value of u (T,), in which the position keeps changing."""
    span = float(np.ptp(u))
    if span <= 0.0:
        return np.zeros(len(u), dtype=np.bool_)
    change = np.abs(np.diff(u, prepend=np.inf)) > EQUAL * span
    starts = np.flatnonzero(change)
    lengths = np.diff(starts, append=len(u))
    step = np.abs(np.diff(q, prepend=q[0]))
    goes_on = np.add.reduceat(step, starts) > MOVES * float(step.max()) * lengths
    top = u[starts] >= u.max() - EQUAL * span
    within = ~top & (u[starts] > u.min() + EQUAL * span)
    others = lengths[goes_on & within]
    usual = float(others.max()) if len(others) else np.inf
    return np.asarray(np.repeat(goes_on & top & (lengths >= LONGER * usual), lengths))
