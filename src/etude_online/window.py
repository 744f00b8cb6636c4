"""The last second of measurements, smoothed and differentiated at its middle: samples to learn on line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from etude.errors import UsageError
from etude.types import Array, Channel, Row

ORDER = 3
"""Of the polynomial: the least with which velocity and command both are free of the motion's curvature."""
LARGEST_STEP = 1.5
"""Periods between two measurements beyond which the window starts anew."""


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


@dataclass(frozen=True)
class Source:
    """Where a wanted channel comes from: a measured one, differentiated so many times."""

    wanted: str
    measured: str
    order: int


def sources(wanted: Sequence[str], measured: Sequence[str], channels: Mapping[str, Channel]) -> list[Source]:
    """How each wanted channel is had from those that are measured.

    Raises:
        UsageError: one is neither measured nor the first or second rate of what is.
    """
    found = []
    for name in wanted:
        source, order = name, 0
        while source not in measured and order < 2 and source in channels and channels[source].derivative_of:
            source, order = channels[source].derivative_of, order + 1
        if source not in measured:
            raise UsageError(
                f"learning on line needs {name!r}, which is neither measured nor a rate of what is",
                next_step=f"Measured are {', '.join(measured)}.",
            )
        found.append(Source(name, source, order))
    return found


class CentredWindow:
    """The newest measurements of some channels; `middle` is half a window late.

    A measurement that is not finite or not later than the last is ignored and counted. After a pause, or a
    measurement ignored for its values, the window fills anew: its weights are for an even grid.

    Args:
        wanted: the channels that a sample shall have, and how each is had.
        sizes: parts of each measured channel.
        rate: of the measurements, Hz. seconds: length of the window.

    Attributes:
        ignored: measurements that were not taken.
    """

    MOVES = ("_rows", "_filled", "_next", "_last", "ignored")

    def __init__(
        self, wanted: Sequence[Source], sizes: Mapping[str, int], rate: float, seconds: float
    ) -> None:
        self._count = 2 * round(0.5 * seconds * rate) + 1
        self._weights = polynomial_weights(self._count, 1.0 / rate)
        self._wanted, first = tuple(wanted), 0
        self._places: dict[str, slice] = {}
        for source in wanted:
            if source.measured not in self._places:
                self._places[source.measured] = slice(first, first + sizes[source.measured])
                first += sizes[source.measured]
        self._rows = np.empty((2 * self._count, first))  # each row twice, so that the newest are contiguous
        self._period = 1.0 / rate
        self._filled, self._next, self._last = 0, 0, -np.inf
        self.ignored = 0

    @property
    def names(self) -> tuple[str, ...]:
        """Channels that it takes of a row."""
        return tuple(self._places)

    def miss(self) -> None:
        """A measurement that is not believed: the window fills anew."""
        self.ignored, self._filled = self.ignored + 1, 0

    def push(self, t: float, row: Row) -> None:
        """One measurement: time in s and the channels of one instant."""
        values = np.concatenate([row[name] for name in self._places])
        finite = bool(np.isfinite(values).all()) and np.isfinite(t)
        if not (finite and t > self._last):
            self.ignored += 1
            self._filled = self._filled if finite else 0
            return
        if t - self._last > LARGEST_STEP * self._period:
            self._filled = 0
        self._rows[self._next] = self._rows[self._next + self._count] = values
        self._next = (self._next + 1) % self._count
        self._filled, self._last = self._filled + 1, t

    def middle(self) -> tuple[float, dict[str, Array]] | None:
        """Time and channels of the sample in the middle of the window; None until it is full."""
        if self._filled < self._count:
            return None
        found = self._weights @ self._rows[self._next : self._next + self._count]
        t = self._last - (self._count // 2) * self._period
        return t, {s.wanted: found[s.order, self._places[s.measured]] for s in self._wanted}
