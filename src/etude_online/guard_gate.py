"""Plausibility gate of measured rows: ranges, steps, and sent against measured commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from etude.types import Array, Channel, Mask, Row
from etude_online.guard_effort import COMMAND

BEYOND = 1.05
"""Of a command's range, to which it is measured at most."""
FURTHER, LARGEST = 10.0, 1e6
"""Times a channel's reach that a measurement may be at most; any number, in SI units."""
CONTRADICTS, SINGLE = 6.0, 48.0
"""Deviations of the feedback's law by which the mean of a decision, or one tick, is off at most."""
STRIKES, AGAIN_S = 3, 1.0
"""Bad decisions in a row after which the trained model drives alone, and s of good ones that end it."""


class Ranges:
    """What no measurement exceeds, from the description of the robot's channels.

    Args:
        channels: of the kind. limits: lower and upper (J,) of the commands; sigma (J,): of their measurement.
        path: the channel whose steps are looked at. period: s of a tick.
    """

    STATE_FIELDS = ("_last",)

    def __init__(
        self,
        channels: Mapping[str, Channel],
        limits: tuple[Array, Array],
        sigma: Array | None,
        path: str,
        period: float,
    ) -> None:
        self._path = path
        most = FURTHER * (np.zeros(len(limits[0])) if sigma is None else sigma)
        self._command = BEYOND * np.maximum(*np.abs(limits)) + most
        self._reach = {
            n: FURTHER * np.array(c.reach) for n, c in channels.items() if c.reach and n != COMMAND
        }
        rate = next((c for c in channels.values() if path and c.derivative_of == path), None)
        has_reach = rate is not None and len(rate.reach) > 0
        self._step = FURTHER * np.array(rate.reach) * period if has_reach and rate is not None else None
        self._last: Array | None = None

    def impossible(self, row: Row, names: Sequence[str]) -> str:
        """The impossible channel and its value; "" if all are possible."""
        for name in names:
            values = row.get(name)
            if values is None:
                return f"{name} is missing"
            most = self._command if name == COMMAND else self._reach.get(name, LARGEST)
            # written so that NaN is impossible too
            bad = ~(np.abs(values) <= np.minimum(most, LARGEST))
            if bad.any():
                return f"{name} = {float(np.asarray(values)[bad][0]):.4g}"
        return self._jump(row)

    def _jump(self, row: Row) -> str:
        if self._path not in row:
            return ""
        now, before = np.array(row[self._path], dtype=float), self._last
        self._last = now
        if self._step is None or before is None or (np.abs(now - before) <= self._step).all():
            return ""
        return f"{self._path} jumped by {float(np.abs(now - before).max()):.4g}"


class Gate:
    """Decisions in which the measured command is not what was sent and fed back, and what follows.

    Attributes:
        faded: whether the trained model drives alone. bad: decisions that contradicted, in all.
    """

    STATE_FIELDS = ("faded", "bad", "_strikes", "_good")

    def __init__(self, sigma: Array, limits: tuple[Array, Array], period: float) -> None:
        self._sigma, self._limits = sigma, limits
        self._needed = round(AGAIN_S / period)
        self.faded, self.bad = False, 0
        self._strikes = self._good = 0

    def contradicted(self, measured: Array, sent: Array, fed_back: Array) -> Mask:
        """(J,) of the ticks (n, J) of one decision; what the drives cut off is no contradiction."""
        of_mean = measured.mean(axis=0) - np.clip((sent + fed_back).mean(axis=0), *self._limits)
        of_ticks = measured - np.clip(sent + fed_back, *self._limits)
        off = np.abs(of_mean) > CONTRADICTS * self._sigma
        return np.asarray(off | (np.abs(of_ticks).max(axis=0) > SINGLE * self._sigma))

    def take(self, bad: bool) -> bool | None:
        """Counts one decision; True where the trained model alone begins to drive, False where that ends."""
        if bad:
            self.bad, self._good, self._strikes = self.bad + 1, 0, self._strikes + 1
            if self._strikes >= STRIKES and not self.faded:
                self.faded = True
                return True
            return None
        self._strikes, self._good = 0, self._good + 1
        if self.faded and self._good >= self._needed:
            self.faded = False
            return False
        return None
