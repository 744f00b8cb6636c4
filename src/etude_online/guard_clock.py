"""A clock of one's own: the robot's may stand still, jump, or run backwards; learning goes on."""

from __future__ import annotations

import math

LATE = 1.5
"""Periods between two measurements beyond which some were missed."""
PAUSE_S = 1.0
"""A longer gap is a jump of the clock: a robot that stood for longer has nothing to go on with."""


class OwnClock:
    """Time that only ever goes on, a period at each measurement; gaps up to a second are believed.

    Args:
        period: s between two measurements.

    Attributes:
        now: own time of the last measurement, s; NaN before the first.
        rebased: how often the clock jumped, ran backwards or stood still.
        fresh: whether the next jump is none, because this clock was stopped before it.
        paused: whether some measurements were missed before the last one.
    """

    fresh = False

    MOVES = ("now", "rebased", "paused", "_raw")

    def __init__(self, period: float) -> None:
        self._period, self._raw = period, math.nan
        self.now, self.rebased, self.paused = math.nan, 0, False

    def tick(self, t: float) -> bool:
        """Takes the next measurement's time t (s); returns whether the clock was believed."""
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
