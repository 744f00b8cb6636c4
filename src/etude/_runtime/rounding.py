"""Counts from quotients such as duration times rate, robust to rounding of whole numbers."""

from __future__ import annotations

import math

COMPUTED = 1e-9
"""A quotient of numbers that are given is a whole number up to this."""
MEASURED = 1e-6
"""The same of a rate that was measured on time stamps."""


def whole_up(quotient: float, rounding: float = COMPUTED) -> int:
    """The smallest whole number that is not below the quotient."""
    return math.ceil(quotient - rounding)


def whole_down(quotient: float, rounding: float = COMPUTED) -> int:
    """The largest whole number that is not above the quotient."""
    return math.floor(quotient + rounding)
