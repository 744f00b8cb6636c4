"""Where set-points come from: along the path, slower along it, or away from it to rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.drivers.contract import About, PlannedMotion
from etude.types import Array

ON_A_ROW = 1e-6
"""Cycles: nearer to a row than that is on it."""
PACE_CURVATURE = 60.0
"""1/s^2, of the pace of a path: from full speed to rest in 0.26 s where accelerations leave the room."""
LANDED = 1e-4
"""Of the pace."""
LONGEST_STOP = 1.0
"""s from full speed to rest, however gentle the motion's own accelerations are."""
GLIDE = 1.5
"""Peak of a cubic's slope over its mean."""


@dataclass(frozen=True, eq=False)
class SetPoint:
    """(J,) each. at: trajectory time, s."""

    q: Array
    qd: Array
    qdd: Array
    effort: Array | None
    at: float


def acceleration_limits(motion: PlannedMotion, about: About) -> Array:
    """(J,) what brakings may use: the motion's own peaks at full speed, and what the robot enforces."""
    own: Array = np.abs(motion.qdd).max(axis=0) * (100.0 / motion.speed) ** 2
    return own if about.acceleration is None else np.minimum(own, about.acceleration)


class PathInTime:
    """A motion by trajectory time, run at any rate from 0 to 1 of its speed."""

    def __init__(self, motion: PlannedMotion, rate: float) -> None:
        self.motion, self.rate, self.last = motion, rate, len(motion.t) - 1

    def at(self, s: float, pace: float = 1.0, change: float = 0.0) -> SetPoint:
        """Of trajectory time s; pace: ds/dt; change: of it, 1/s. Between two rows a quintic through both."""
        s = min(max(s, 0.0), self.motion.duration)
        row = min(int(s * self.rate + ON_A_ROW), self.last)
        u = s - float(self.motion.t[row])
        q, qd, qdd, effort = self._row(row) if u * self.rate <= ON_A_ROW else self._between(row, u)
        if pace != 1.0 or change != 0.0:
            qd, qdd = qd * pace, qdd * (pace * pace) + qd * change
        return SetPoint(q, qd, qdd, effort, s)

    def _row(self, row: int) -> tuple[Array, Array, Array, Array | None]:
        own = self.motion
        effort = None if own.effort is None else own.effort[row]
        return own.q[row], own.qd[row], own.qdd[row], effort

    def _between(self, row: int, u: float) -> tuple[Array, Array, Array, Array | None]:
        if row >= self.last:
            return self._row(self.last)
        own, h = self.motion, float(self.motion.t[row + 1] - self.motion.t[row])
        q, qd, qdd = own.q[row], own.qd[row], own.qdd[row]
        # what is left at the next row after the parabola of this one
        d = own.q[row + 1] - (q + h * (qd + 0.5 * h * qdd))
        dd = h * (own.qd[row + 1] - (qd + h * qdd))
        ddd = h * h * (own.qdd[row + 1] - qdd)
        c3, c4, c5 = 10 * d - 4 * dd + 0.5 * ddd, -15 * d + 7 * dd - ddd, 6 * d - 3 * dd + 0.5 * ddd
        x = u / h
        effort = None if own.effort is None else own.effort[row] + x * (own.effort[row + 1] - own.effort[row])
        return (
            q + u * (qd + 0.5 * u * qdd) + x**3 * (c3 + x * (c4 + x * c5)),
            qd + u * qdd + x**2 / h * (3 * c3 + x * (4 * c4 + x * 5 * c5)),
            qdd + x / h**2 * (6 * c3 + x * (12 * c4 + x * 20 * c5)),
            effort,
        )

    def room(self, s: float, pace: float, limits: Array) -> tuple[float, float]:
        """Smallest and largest change of pace, 1/s, inside the acceleration limits (J,).

        No change is inside them at any pace up to 1, since the motion itself is.
        """
        row = min(int(s * self.rate + ON_A_ROW), self.last)
        qd, own = self.motion.qd[row], self.motion.qdd[row] * (pace * pace)
        moving = np.where(np.abs(qd) > 1e-9, qd, 1e-9)
        ends = (-limits - own) / moving, (limits - own) / moving
        return min(float(np.minimum(*ends).max()), 0.0), max(float(np.maximum(*ends).min()), 0.0)


@dataclass
class Pace:
    """ds/dt of a path: 1, 0, or on its way between the two, as fast as the acceleration limits let it."""

    now: float = 1.0
    end: float = 1.0
    change: float = 0.0

    @property
    def steady(self) -> bool:
        return self.now == self.end

    def go_on(self, tick: float, path: PathInTime, s: float, limits: Array) -> None:
        """tick s further. Its slope is a ramp, and it lands without a step."""
        if self.steady or tick <= 0.0:
            self.change = 0.0
            return
        left = self.end - self.now
        wanted = float(np.sign(left) * np.sqrt(2.0 * PACE_CURVATURE * abs(left)))
        step = PACE_CURVATURE * tick
        wanted = min(max(wanted, self.change - step), self.change + step)
        low, high = path.room(s, self.now, limits)
        self.change = min(max(wanted, low), high)
        self.now += self.change * tick
        if abs(self.end - self.now) < LANDED or (self.end - self.now) * left < 0.0:
            self.now = self.end


class Stopping:
    """From a set-point to rest, each joint by itself: its velocity falls as a cubic, without a step in it."""

    def __init__(self, start: SetPoint, limits: Array) -> None:
        self.start = start
        quiet = np.maximum(limits, 1e-9)
        self.span = float(np.clip((GLIDE * np.abs(start.qd) / quiet).max(), 0.02, LONGEST_STOP))

    def at(self, u: float) -> SetPoint:
        """u: s since it began; the end stays."""
        h, own = self.span, self.start
        x = min(u / h, 1.0)
        # cubic Hermite in the velocity: starts with qd and qdd, ends with zeros
        fall, swing = 1 - 3 * x**2 + 2 * x**3, x - 2 * x**2 + x**3
        way, swung = x - x**3 + 0.5 * x**4, x**2 / 2 - 2 * x**3 / 3 + x**4 / 4
        q = own.q + h * (own.qd * way + h * own.qdd * swung)
        qd = own.qd * fall + h * own.qdd * swing
        qdd = own.qd * (6 * x**2 - 6 * x) / h + own.qdd * (1 - 4 * x + 3 * x**2)
        return SetPoint(q, qd, qdd, own.effort, own.at)
