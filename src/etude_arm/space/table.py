"""Limits in space as the table [cartesian] of the robot file.

[cartesian]
point = [0.0, 0.0, 0.1]     # optional: of the tool, m in the frame of the link that the last axis moves
speed = 1.0                 # optional: largest of that point, m/s
link_speed = 1.5            # optional: largest of any point of the robot's shapes, m/s
lower = [0.2, -0.5, 0.1]    # optional, with upper: a box that the point stays in, m in the room
upper = [0.8, 0.5, 0.9]
radius = 0.8                # optional: an upright cylinder that it stays in, m
centre = [0.0, 0.0]
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from etude.errors import UsageError

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Cartesian:
    """Limits of the tool's point, and of the speed of all links; None: no such limit.

    Attributes:
        point: m in the frame of the link that the last axis moves; None: where that link ends.
        speed: of the point; link_speed: of any point of a shape, m/s.
        lower, upper: box, m. radius, centre: cylinder, m.

    Raises:
        UsageError: one end of the box without the other or above it, a size that is not above 0.
    """

    point: Point | None = None
    speed: float | None = None
    link_speed: float | None = None
    lower: Point | None = None
    upper: Point | None = None
    radius: float | None = None
    centre: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("speed", "link_speed", "radius"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise UsageError(f"{name} must be above 0, not {value:g}", where="cartesian")
        low, high = self.lower, self.upper
        if (low is None) != (high is None):
            raise UsageError("a box needs both lower and upper", where="cartesian")
        if low is not None and high is not None and not all(a < b for a, b in zip(low, high, strict=True)):
            raise UsageError(f"lower {low} is not below upper {high}", where="cartesian")
