"""Knots for a receiver that joins points by curves, as dense as the curve needs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from etude._runtime.rounding import MEASURED, whole_up
from etude.deploy.feedforward import MotionWithCommands, motion_and_command
from etude.errors import UsageError
from etude.limits.certificate import REST_TOLERANCE
from etude.protocols import Kind, Trajectory
from etude.trajectories.splined import Splined
from etude.types import Array, Index

NANO = 10**9  # ns in a second
SLOWEST, FASTEST = 10.0, 1000.0
"""Points per second: quintics through ten are mostly within 1e-8 of a series."""
CLOSE = 1e-7
"""Largest distance of the curve from the motion, as a part of the path's size."""
EFFORT_RATE = 100.0
"""Points per second where commands go along: receivers join these by lines."""
SPACE = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class Knots:
    """Points of a motion at whole nanoseconds.

    Attributes:
        names: of the coordinates.
        nanoseconds: (K,) increasing, from 0.
        points: (O, K, k) position and derivatives, in rad or m.
        command: (K, J) in the robot's command unit, or None.
        form: of the motion.
    """

    names: tuple[str, ...]
    nanoseconds: Index
    points: Array
    command: Array | None
    form: str

    @property
    def times(self) -> Array:
        """Times (K,) s."""
        return np.asarray(self.nanoseconds / NANO)

    def played(self) -> Splined:
        """The curve through the points."""
        return Splined(self.times, self.points, like=self.form)


def knots_of(what: Trajectory | MotionWithCommands, kind: Kind, spec: Any, orders: int) -> Knots:
    """The fewest points whose curve stays within CLOSE of the motion.

    Args:
        what: the motion, with or without commands. kind: of the robot. spec: its description.
        orders: number of derivatives in a point, position included.

    Raises:
        UsageError: a thousand points per second do not suffice.
    """
    motion, command = motion_and_command(what)
    rate = EFFORT_RATE if command else SLOWEST
    # 40 Hz and 2000 parts of the motion: interpolation errors are looked for between knots that are wider
    fine = np.linspace(0.0, motion.duration, max(2001, math.ceil(40.0 * motion.duration)))
    path = motion.motion(fine, 1).orders[0]
    size = max(float(np.ptp(path, axis=0).max()), float(np.finfo(float).tiny))
    while rate <= FASTEST:
        knots = _at_rate(motion, names_of(kind, spec), rate, orders)
        error = np.abs(knots.played().motion(fine, 1).orders[0] - path).max()
        if error <= CLOSE * size:
            values = command(knots.times) if command else None
            return Knots(knots.names, knots.nanoseconds, knots.points, values, knots.form)
        rate *= 2.0
    raise UsageError(
        f"the motion is too fast for {FASTEST:g} points per second",
        next_step="Run it slower: etude ask --speed 50.",
    )


def names_of(kind: Kind, spec: Any) -> tuple[str, ...]:
    """Names of the path's coordinates."""
    return next(c.parts for c in kind.channels(spec) if c.name == kind.path)


class MovesJoints:
    """Base of exporters for robots whose path is in joints.

    Attributes:
        written: the format, in the refusal's words.
    """

    written: ClassVar[str] = "a JointTrajectory"

    def require_robot(self, kind: Kind, spec: Any) -> None:
        """UsageError: the robot's path is in space."""
        if names_of(kind, spec) == SPACE:
            raise UsageError(f"{self.written} moves joints, but the path of {spec.name!r} is x, y, z")


def require_space(kind: Kind, spec: Any, what: str) -> None:
    """Raises UsageError unless the robot's path is in space."""
    if names_of(kind, spec) != SPACE:
        raise UsageError(f"{what} needs a path of x, y, z, but {spec.name!r} has none")


def grid_of(motion: Trajectory, rate: float) -> Index:
    """Times (K,) ns of the pieces' ends, and at least `rate` times a second in between."""
    ends = [0]
    for start, _, piece in motion.pieces():
        for edge in (start, start + piece.duration):
            ends.append(round(edge * NANO))
    ends = sorted({*ends, round(motion.duration * NANO)})
    parts = [
        np.linspace(a, b, max(1, whole_up((b - a) / NANO * rate, MEASURED)) + 1)[:-1]
        for a, b in pairwise(ends)
    ]
    whole: Index = np.rint(np.concatenate([*parts, [ends[-1]]])).astype(np.int64)
    return whole


def _at_rate(motion: Trajectory, names: tuple[str, ...], rate: float, orders: int) -> Knots:
    nanoseconds = grid_of(motion, rate)
    t = np.minimum(nanoseconds / NANO, motion.duration)
    points = np.ascontiguousarray(motion.motion(t, orders).orders)
    # rest is exact in what is sent: controllers refuse a motion that ends in motion, and hold the last point
    # with its acceleration
    for order in range(1, orders):
        size = np.abs(points[order]).max()
        for end in (0, -1):
            if np.abs(points[order, end]).max() <= REST_TOLERANCE * size:
                points[order, end] = 0.0
    return Knots(names, nanoseconds, points, None, motion.form)
