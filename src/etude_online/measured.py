"""From rows as they come to samples that can be true: own clock, ranges, window."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from etude.types import Array, Channel, Row
from etude_online.guard_clock import OwnClock
from etude_online.guard_gate import Ranges
from etude_online.window import CentredWindow, sources

COMMAND = "command"


class Measured:
    """The newest believed measurements.

    Args:
        inputs: channels that the model looks at. channels: of the kind, by name.
        also: channels that have to be finite too, because a guard judges by them.
        rate: of the ticks, Hz. window_s: see `OnlineConfig`.
        say: receives a sentence where something is not believed, until a second without.
    """

    MOVES = ("_clock", "_ranges", "_window", "_odd")

    def __init__(
        self,
        inputs: Sequence[str],
        channels: Mapping[str, Channel],
        ranges: Ranges,
        also: Sequence[str],
        rate: float,
        window_s: float,
        say: Callable[[str], None],
    ) -> None:
        self._inputs, self._channels, self._also = inputs, channels, also
        self._ranges, self._rate, self._seconds, self._say = ranges, rate, window_s, say
        self._clock = OwnClock(1.0 / rate)
        self._window: CentredWindow | None = None
        self.sizes: dict[str, int] = {}
        self._odd = -math.inf

    @property
    def now(self) -> float:
        """Own time of the last measurement, s; NaN before the first."""
        return self._clock.now

    @property
    def paused(self) -> bool:
        """Whether measurements were missed before the last one."""
        return self._clock.paused

    @property
    def counts(self) -> tuple[int, int]:
        """Measurements that cannot be true, and times that the clock was not believed."""
        return (0 if self._window is None else self._window.ignored), self._clock.rebased

    def begin(self, sizes: Mapping[str, int]) -> None:
        """From the parts of each channel that will be measured.

        Raises:
            UsageError: what the model looks at is neither measured nor a rate of what is.
        """
        self.sizes = {name: size for name, size in sizes.items() if name in self._channels}
        # physics may look at states that the inputs do not
        more = [name for name in self.sizes if self._channels[name].role == "state"]
        wanted = list(dict.fromkeys([*self._inputs, COMMAND, *more]))
        found = sources(wanted, list(self.sizes), self._channels)
        self._window = CentredWindow(found, self.sizes, self._rate, self._seconds)

    def reopened(self) -> None:
        """After it was stopped the robot's clock may say anything, once."""
        self._clock.fresh = True

    def take(self, t: float, row: Row) -> bool:
        """One measurement; returns whether it can be true."""
        if self._window is None:
            self.begin({name: len(np.atleast_1d(values)) for name, values in row.items()})
        assert self._window is not None
        if not self._clock.tick(t):
            self.odd(f"The clock says {t:.6g} s: learning goes on by its own")
        why = self._ranges.impossible(row, (*self._window.names, *self._also))
        if why:
            self._window.miss()
            self.odd(f"A measurement cannot be true and is not learned: {why}")
            return False
        self._window.push(self.now, row)
        return True

    def odd(self, text: str) -> None:
        """Says it once, until a second without."""
        if not self.now < self._odd:
            self._say(text + ".")
        self._odd = self.now + 1.0

    def middle(self) -> tuple[float, dict[str, Array]] | None:
        """Time and channels of the newest sample; None while the window fills."""
        return None if self._window is None else self._window.middle()
