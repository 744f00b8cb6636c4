"""Refusals that drivers of vehicles share: axes, charge and heading before a motion begins."""

from __future__ import annotations

import math
from collections.abc import Sequence

from etude.errors import UsageError

AXES = ("x", "y", "z")
HEADING = 0.3
"""rad by which a vehicle may look away from the x axis."""


def require_axes(joints: Sequence[str], driver: str) -> None:
    """UsageError: the campaign is of no vehicle."""
    if tuple(joints) != AXES:
        raise UsageError(
            f"{driver} flies along x, y and z, not {', '.join(joints)}",
            next_step="Give it a vehicle's campaign.",
        )


def require_charge(left: float, least: float) -> None:
    """ConnectionError: the battery has less than that part of its charge."""
    if left < least:
        raise ConnectionError(f"the battery has {left:.0%} left, and {least:.0%} are asked for")


def require_heading(off: float, ahead: str = "the x axis") -> None:
    """ConnectionError: it looks that far away from the x axis, rad.

    Args:
        off: rad, of either sign. ahead: what is ahead, in the vehicle's words.
    """
    if abs(off) > HEADING:
        raise ConnectionError(f"it looks {math.degrees(abs(off)):.0f} degrees away from {ahead}: turn it")


def yaw_of(w: float, x: float, y: float, z: float) -> float:
    """rad about the vertical, of a quaternion."""
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
