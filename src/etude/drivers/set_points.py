"""Sources of set-points: along the path, slower along it, or away from it to rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.drivers.contract import About, PlannedMotion
from etude.drivers.within_limits import velocity_range
from etude.types import Array, Mask

ON_A_ROW = 1e-6
"""Cycles: a time within this distance of a row is on the row."""
PACE_CURVATURE = 60.0
"""1/s^2, of the pace of a path: from full speed to rest in 0.26 s where accelerations leave the room."""
LANDED = 1e-4
"""Difference of pace that counts as none."""
SHORTEST_STOP, LONGEST_STOP = 0.02, 1.0
"""s to rest; at most that from full speed, however gentle the motion's own accelerations are."""
RAMP = 1 / 8
"""Part of a braking in which its acceleration rises, and in which it falls."""
CATCH_UP, CATCH_UP_IN, CATCH_UP_RAMP = 0.02, 0.25, 0.2
"""Largest extra speed of a path that lags, as a part of its speed; s in which it would catch up without that
bound; 1/s by which this part grows."""
EARLY = 1.5
"""Largest advance of set-points in quick succession, in periods, since cycles are not exactly even."""


@dataclass(frozen=True, eq=False)
class SetPoint:
    """(J,) each. at: trajectory time, s."""

    q: Array
    qd: Array
    qdd: Array
    effort: Array | None
    at: float


def acceleration_limits(motion: PlannedMotion, about: About) -> Array:
    """(J,) acceleration limits of braking: the motion's peaks at full speed, and those of the robot."""
    peaks: Array = np.abs(motion.qdd).max(axis=0) * (100.0 / motion.speed) ** 2
    return peaks if about.acceleration is None else np.minimum(peaks, about.acceleration)


def room_to_catch_up(motion: PlannedMotion, about: About) -> Mask:
    """(n,) rows from which on, until it is back at its own speed, the motion may be faster by `CATCH_UP`.

    Velocities and accelerations then stay inside the peaks of the motion at full speed and what the robot
    enforces.
    """
    most = acceleration_limits(motion, about)
    fastest = np.abs(motion.qd).max(axis=0) * (100.0 / motion.speed)
    fastest = fastest if about.velocity is None else np.minimum(fastest, about.velocity)
    qd = (1.0 + CATCH_UP) * motion.qd
    inside = (np.abs(qd) <= fastest) & (
        np.abs(motion.qdd) * (1.0 + CATCH_UP) ** 2 + CATCH_UP_RAMP * np.abs(qd) <= most
    )
    if about.envelope is not None:
        low, high = velocity_range(about.envelope, motion.q)
        inside &= (qd >= low) & (qd <= high)
    rows = int(np.ceil(CATCH_UP / CATCH_UP_RAMP * about.rate)) + 2
    outside = np.cumsum(np.append(0, ~inside.all(axis=1)))
    n = len(motion.t)
    return np.asarray(outside[np.minimum(np.arange(n) + rows, n)] == outside[:n])


class PathInTime:
    """A motion by trajectory time, run at any rate from 0 to 1 of its speed."""

    def __init__(self, motion: PlannedMotion, rate: float) -> None:
        self.motion, self.rate, self.last = motion, rate, len(motion.t) - 1

    def at(self, s: float, pace: float = 1.0, change: float = 0.0) -> SetPoint:
        """Set-point at trajectory time s, by quintic interpolation. pace: ds/dt; change: its rate, 1/s."""
        s = min(max(s, 0.0), self.motion.duration)
        row = self.row(s)
        u = s - float(self.motion.t[row])
        q, qd, qdd, effort = self._row(row) if u * self.rate <= ON_A_ROW else self._interpolated(row, u)
        if pace != 1.0 or change != 0.0:
            qd, qdd = qd * pace, qdd * (pace * pace) + qd * change
        return SetPoint(q, qd, qdd, effort, s)

    def row(self, s: float) -> int:
        """Index of the last row at or before trajectory time s."""
        return min(int(s * self.rate + ON_A_ROW), self.last)

    def _row(self, row: int) -> tuple[Array, Array, Array, Array | None]:
        motion = self.motion
        effort = None if motion.effort is None else motion.effort[row]
        return motion.q[row], motion.qd[row], motion.qdd[row], effort

    def _interpolated(self, row: int, u: float) -> tuple[Array, Array, Array, Array | None]:
        if row >= self.last:
            return self._row(self.last)
        motion, h = self.motion, float(self.motion.t[row + 1] - self.motion.t[row])
        q, qd, qdd = motion.q[row], motion.qd[row], motion.qdd[row]
        # what is left at the next row after the parabola of this one
        d = motion.q[row + 1] - (q + h * (qd + 0.5 * h * qdd))
        dd = h * (motion.qd[row + 1] - (qd + h * qdd))
        ddd = h * h * (motion.qdd[row + 1] - qdd)
        c3, c4, c5 = 10 * d - 4 * dd + 0.5 * ddd, -15 * d + 7 * dd - ddd, 6 * d - 3 * dd + 0.5 * ddd
        x = u / h
        effort = (
            None
            if motion.effort is None
            else motion.effort[row] + x * (motion.effort[row + 1] - motion.effort[row])
        )
        return (
            q + u * (qd + 0.5 * u * qdd) + x**3 * (c3 + x * (c4 + x * c5)),
            qd + u * qdd + x**2 / h * (3 * c3 + x * (4 * c4 + x * 5 * c5)),
            qdd + x / h**2 * (6 * c3 + x * (12 * c4 + x * 20 * c5)),
            effort,
        )

    def room(self, s: float, pace: float, limits: Array) -> tuple[float, float]:
        """Smallest and largest change of pace, 1/s, inside the acceleration limits (J,).

        0 is always allowed, since the motion itself is inside them at any pace up to 1.
        """
        row = self.row(s)
        qd, qdd = self.motion.qd[row], self.motion.qdd[row] * (pace * pace)
        moving = np.where(np.abs(qd) > 1e-9, qd, 1e-9)
        ends = (-limits - qdd) / moving, (limits - qdd) / moving
        return min(float(np.minimum(*ends).max()), 0.0), max(float(np.maximum(*ends).min()), 0.0)


@dataclass
class Pace:
    """ds/dt of a path: 1, 0, or in transition between them at the acceleration limits."""

    now: float = 1.0
    end: float = 1.0
    change: float = 0.0

    @property
    def steady(self) -> bool:
        return self.now == self.end

    def go_on(self, tick: float, path: PathInTime, s: float, limits: Array) -> None:
        """Advance by tick s. The pace changes by a ramp and reaches its end without a step."""
        if self.steady or tick <= 0.0:
            self.change = 0.0
            return
        remaining = self.end - self.now
        slope = float(np.sign(remaining) * np.sqrt(2.0 * PACE_CURVATURE * abs(remaining)))
        step = PACE_CURVATURE * tick
        slope = min(max(slope, self.change - step), self.change + step)
        low, high = path.room(s, self.now, limits)
        self.change = min(max(slope, low), high)
        self.now += self.change * tick
        if abs(self.end - self.now) < LANDED or (self.end - self.now) * remaining < 0.0:
            self.now = self.end


class PathClock:
    """How far the path goes on in each cycle: by one period, however many cycles were lost before it.

    A robot may have held the last set-point meanwhile, and more than one period would be a jump to it. The
    path then lags behind the robot's clock, and catches up slowly where it has the room.

    Attributes:
        speed: of the path's time; change: of it, 1/s. lag: s behind the robot's clock.
    """

    def __init__(self, period: float) -> None:
        self.period = period
        self.speed, self.change, self.lag = 1.0, 0.0, 0.0
        self._early = EARLY * period

    def step(self, robot: float, ours: float, room: bool) -> float:
        """Path time of this cycle, s. robot, ours: s since the last one; room: the path may run faster."""
        even, step = 0.5 * self.period, CATCH_UP_RAMP * self.period
        beyond = self.lag - min(max(self.lag, -even), even)
        target = 1.0 + min(max(beyond / CATCH_UP_IN, -CATCH_UP), CATCH_UP if room else 0.0)
        before = self.speed
        self.speed = min(max(target, before - step), before + step)
        self.change = (self.speed - before) / self.period
        passed = (1.0 + CATCH_UP) * min(robot, ours)
        self._early = min(self._early + passed, EARLY * self.period)
        tick = min(self.speed * self.period, self._early)
        self._early -= tick
        self.lag += robot - tick
        return tick


class Stopping:
    """Braking from a set-point to rest, joint by joint: the acceleration rises to a plateau, then falls."""

    def __init__(self, start: SetPoint, limits: Array) -> None:
        self.start = start
        toward = np.sign(start.qd) * np.clip(start.qdd, -limits, limits)
        most = (1.0 - RAMP) * np.maximum(limits, 1e-9) - 0.5 * RAMP * toward
        self.span = float(np.clip((np.abs(start.qd) / most).max(), SHORTEST_STOP, LONGEST_STOP))
        self.plateau = -(start.qd / self.span + 0.5 * RAMP * start.qdd) / (1.0 - RAMP)

    def at(self, u: float) -> SetPoint:
        """Set-point at u s after the start; at rest after the end."""
        start, remaining = self.start, min(u, self.span)
        q, qd, qdd = start.q, start.qd, start.qdd
        for part, end in ((RAMP, self.plateau), (1.0 - 2.0 * RAMP, self.plateau), (RAMP, 0.0 * start.q)):
            length = part * self.span
            h = min(max(remaining, 0.0), length)
            jerk = (end - qdd) / length
            q = q + h * (qd + h * (0.5 * qdd + h * jerk / 6.0))
            qd, qdd = qd + h * (qdd + 0.5 * h * jerk), qdd + h * jerk
            remaining -= length
        is_moving = 0.0 if u >= self.span else 1.0  # exactly: controllers refuse an end that moves
        return SetPoint(q, is_moving * qd, is_moving * qdd, start.effort, start.at)
