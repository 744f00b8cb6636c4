"""Jets: a quantity with its first two time derivatives, so that products need no formulas by hand.

Only what is complex-analytic: no moduli, so that a complex step through them is an exact derivative.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Values = NDArray[Any]  # real, or complex on a complex step


@dataclass(frozen=True)
class Jet:
    """f, f', f'' of a scalar; arrays of one shape, real or complex."""

    value: Values
    first: Values
    second: Values

    def __add__(self, other: Jet) -> Jet:
        return Jet(self.value + other.value, self.first + other.first, self.second + other.second)

    def __sub__(self, other: Jet) -> Jet:
        return Jet(self.value - other.value, self.first - other.first, self.second - other.second)

    def __mul__(self, other: Jet) -> Jet:
        f, g = self, other
        second = f.second * g.value + 2.0 * f.first * g.first + f.value * g.second
        return Jet(f.value * g.value, f.first * g.value + f.value * g.first, second)

    def inverse_root(self) -> Jet:
        """f^(-1/2)."""
        value = 1.0 / np.sqrt(self.value)
        rate = -0.5 * value / self.value
        bend = -1.5 * rate / self.value
        return Jet(value, rate * self.first, bend * self.first**2 + rate * self.second)


def unit(a: tuple[Jet, ...]) -> tuple[Jet, ...]:
    """a/|a|, by the root of the sum of squares."""
    square = a[0] * a[0]
    for part in a[1:]:
        square = square + part * part
    scale = square.inverse_root()
    return tuple(part * scale for part in a)


def dot(a: tuple[Values, ...], b: tuple[Values, ...]) -> Values:
    """Inner product of two vectors given by components."""
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])
