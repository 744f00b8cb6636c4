"""Samples from rows as they arrive: own clock, range checks, and a smoothing window."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from etude.errors import UsageError
from etude.types import Array, Channel, Row
from etude_online.guard_gate import Ranges

COMMAND = "command"


LATE = 1.5
"""Periods between two measurements beyond which some were missed."""
PAUSE_S = 1.0
"""A longer gap is a jump of the clock: a robot that stood for longer has nothing to go on with."""


class OwnClock:
    """Time that only increases, a period at each measurement; gaps up to a second are accepted.

    Args:
        period: s between two measurements.

    Attributes:
        now: own time of the last measurement, s; NaN before the first.
        rebased: how often the clock jumped, ran backwards or stood still.
        fresh: whether the next jump is none, because this clock was stopped before it.
        paused: whether some measurements were missed before the last one.
    """

    fresh = False

    STATE_FIELDS = ("now", "rebased", "paused", "_raw")

    def __init__(self, period: float) -> None:
        self._period, self._raw = period, math.nan
        self.now, self.rebased, self.paused = math.nan, 0, False

    def tick(self, t: float) -> bool:
        """Takes the next measurement's time t (s); returns whether the clock was accepted."""
        step, self._raw = t - self._raw, t
        if math.isnan(self.now):
            self.now = t if math.isfinite(t) else 0.0
            return math.isfinite(t)
        self.paused = LATE * self._period < step <= PAUSE_S
        if self.paused:
            self.now += step
        elif 0.0 < step <= LATE * self._period:
            self.now += self._period
        elif self.fresh:  # it was saved and opened again, and the robot's clock may be another one
            self.now += 2.0 * self._period
        else:  # as if one measurement had been missed: the window starts anew, and time goes on
            self.now += 2.0 * self._period
            self.rebased += 1
            return False
        self.fresh = False
        return True


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
    """Source of a required channel: a measured one, and the order of its derivative."""

    channel: str
    measured: str
    order: int


def sources(
    required: Sequence[str], measured: Sequence[str], channels: Mapping[str, Channel]
) -> list[Source]:
    """How each required channel is obtained from the measured ones.

    Raises:
        UsageError: one is neither measured nor the first or second rate of what is.
    """
    resolved = []
    for name in required:
        source, order = name, 0
        while source not in measured and order < 2 and source in channels and channels[source].derivative_of:
            source, order = channels[source].derivative_of, order + 1
        if source not in measured:
            raise UsageError(
                f"online learning needs {name!r}, which is neither measured nor a rate of a measured channel",
                next_step=f"Measured are {', '.join(measured)}.",
            )
        resolved.append(Source(name, source, order))
    return resolved


class CentredWindow:
    """The newest measurements of some channels; `middle` is half a window late.

    A measurement that is not finite or not later than the last is ignored and counted. After a pause, or a
    measurement ignored for its values, the window fills anew: its weights are for an even grid.

    Args:
        outputs: channels of a sample, and how each is obtained.
        sizes: parts of each measured channel.
        rate: of the measurements, Hz. seconds: length of the window.

    Attributes:
        ignored: measurements that were not taken.
    """

    STATE_FIELDS = ("_rows", "_filled", "_next", "_last", "ignored")

    def __init__(
        self, outputs: Sequence[Source], sizes: Mapping[str, int], rate: float, seconds: float
    ) -> None:
        self._count = 2 * round(0.5 * seconds * rate) + 1
        self._weights = polynomial_weights(self._count, 1.0 / rate)
        self._outputs, first = tuple(outputs), 0
        self._places: dict[str, slice] = {}
        for source in outputs:
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
        """A rejected measurement: the window fills anew."""
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
        derivatives = self._weights @ self._rows[self._next : self._next + self._count]
        t = self._last - (self._count // 2) * self._period
        return t, {s.channel: derivatives[s.order, self._places[s.measured]] for s in self._outputs}


class Measured:
    """The newest accepted measurements.

    Args:
        inputs: channels that the model looks at. channels: of the kind, by name.
        also: channels that have to be finite too, because a guard uses them.
        rate: of the ticks, Hz. window_s: see `OnlineConfig`.
        say: receives a sentence where something is rejected, until a second without.
    """

    STATE_FIELDS = ("_clock", "_ranges", "_window", "_odd")

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
        """Impossible measurements, and rejected jumps of the clock."""
        return (0 if self._window is None else self._window.ignored), self._clock.rebased

    def begin(self, sizes: Mapping[str, int]) -> None:
        """From the parts of each channel that will be measured.

        Raises:
            UsageError: what the model looks at is neither measured nor a rate of what is.
        """
        self.sizes = {name: size for name, size in sizes.items() if name in self._channels}
        # physics may look at states that the inputs do not
        more = [name for name in self.sizes if self._channels[name].role == "state"]
        required = list(dict.fromkeys([*self._inputs, COMMAND, *more]))
        resolved = sources(required, list(self.sizes), self._channels)
        self._window = CentredWindow(resolved, self.sizes, self._rate, self._seconds)

    def reopened(self) -> None:
        """After it was stopped the robot's clock may say anything, once."""
        self._clock.fresh = True

    def take(self, t: float, row: Row) -> bool:
        """One measurement; returns whether it can be true."""
        if self._window is None:
            self.begin({name: len(np.atleast_1d(values)) for name, values in row.items()})
        assert self._window is not None
        if not self._clock.tick(t):
            self.odd(f"The clock shows {t:.6g} s: learning continues with its own clock")
        why = self._ranges.impossible(row, (*self._window.names, *self._also))
        if why:
            self._window.miss()
            self.odd(f"A measurement is implausible and not learned: {why}")
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
