"""Scales from data to pixels: axes and readable ticks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from etude._runtime.rounding import whole_down, whole_up
from etude.types import Array


@dataclass(frozen=True)
class Axis:
    """One axis of a panel.

    Attributes:
        label: quantity with its unit.
        log: logarithmic.
        limits: (low, high), or None for the extent of the marks.
        floor: with `limits` None, the axis includes this value.
        whole: ticks at whole numbers only.
    """

    label: str
    log: bool = False
    limits: tuple[float, float] | None = None
    floor: float | None = None
    whole: bool = False


@dataclass(frozen=True)
class Scale:
    """Maps data in [low, high] to pixels in [start, end]."""

    low: float
    high: float
    start: float
    end: float
    log: bool = False
    whole: bool = False

    def __call__(self, values: ArrayLike) -> Array:
        x = np.asarray(values, dtype=float)
        low, high = self.low, self.high
        if self.log:
            x, low, high = np.log(np.maximum(x, 1e-300)), math.log(low), math.log(high)
        return np.asarray(self.start + (x - low) / (high - low) * (self.end - self.start))

    def ticks(self) -> list[float]:
        """Round values inside [low, high]."""
        ticks = log_ticks(self.low, self.high) if self.log else linear_ticks(self.low, self.high)
        return [tick for tick in ticks if not self.whole or abs(tick - round(tick)) < 1e-9]


def fitted_scale(axis: Axis, values: Array, start: float, end: float) -> Scale:
    """The scale of an axis whose marks have these `values`, with a small space at both ends."""
    if axis.limits is not None:
        return Scale(*axis.limits, start, end, axis.log, axis.whole)
    usable = values[np.isfinite(values) & ((values > 0) | (not axis.log))]
    low, high = (float(usable.min()), float(usable.max())) if usable.size else (1.0, 2.0)
    if axis.floor is not None:
        low = min(low, axis.floor)
    if axis.log:
        return Scale(low / 1.25, high * 1.25, start, end, log=True, whole=axis.whole)
    air = 0.06 * (high - low) or 0.5 * abs(high) or 1.0
    return Scale(low if low == axis.floor else low - air, high + air, start, end, whole=axis.whole)


def linear_ticks(low: float, high: float, count: int = 5) -> list[float]:
    """Multiples of 1, 2 or 5 times a power of ten; about `count` of them."""
    raw = (high - low) / count
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(s * power for s in (1, 2, 5, 10) if s * power >= raw * 0.75)
    first = whole_up(low / step)
    last = whole_down(high / step)
    return [index * step for index in range(first, last + 1)]


def log_ticks(low: float, high: float) -> list[float]:
    """Powers of ten, with 2 and 5 between them where there is room."""
    decades = math.log10(high / low)
    steps = (1, 2, 5) if decades < 3.2 else (1,)
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    return [s * 10.0**p for p in powers for s in steps if low <= s * 10.0**p <= high]


def tick_text(value: float) -> str:
    """A tick's label, without trailing noise."""
    if value == 0 or abs(value) < 1e-12:
        return "0"
    if 1e-4 <= abs(value) < 1e6:
        return f"{value:.10g}".replace("-", "−") if abs(value) < 1e4 else f"{value:,.0f}".replace("-", "−")
    return f"{value:.0e}".replace("-", "−")
