"""Crazyflie's poly4d: pieces of four polynomials (x, y, z, yaw) of degree 7 in its trajectory memory.

A row is `duration, x^0 .. x^7, y^0 .., z^0 .., yaw^0 ..`, the file that Crazyswarm and cflib load; they send
single precision. A piece has 132 bytes and the memory 4,096, so there are at most 31 pieces.
"""

from __future__ import annotations

import csv
import io
import itertools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from etude.deploy.exporters.knots import require_space
from etude.deploy.feedforward import MotionWithCommands, motion_and_command
from etude.errors import UsageError
from etude.protocols import Kind, Trajectory
from etude.trajectories.splined import Splined
from etude.types import Array, Index

FILE = "poly4d.csv"
PIECES = 31  # 4,096 bytes of memory, 132 a piece
COEFFICIENTS = 8  # of a polynomial of degree 7
ORDERS = 4
"""Position to jerk at both ends of a piece give its eight coefficients."""
CLOSE = 1e-3
"""m: largest difference between pieces and motion: a tenth of a Crazyflie's tracking error."""

MEET = 1e-4
"""m: largest gap between pieces in single precision."""


class Poly4d:
    """A `protocols.Exporter`: one CSV file for `Crazyflie.uploadTrajectory` and similar functions. Heading
    zero.
    """

    def __call__(self, what: Trajectory | MotionWithCommands, kind: Kind, spec: Any) -> Mapping[str, bytes]:
        """The file. UsageError: no path in space, or one that 31 pieces cannot approximate."""
        self.require_robot(kind, spec)
        motion, _ = motion_and_command(what)
        times, error = _edges(motion)
        if not error <= CLOSE:
            raise UsageError(
                f"{PIECES} pieces, all that a Crazyflie holds, miss the motion by {error:.3g} m",
                next_step="Write fewer harmonics in [trajectory] of campaign.toml, then etude ask --new.",
            )
        points = motion.motion(times, ORDERS).orders
        return {FILE: _text(times, _coefficients(times, points)).encode()}

    def require_robot(self, kind: Kind, spec: Any) -> None:
        """UsageError: no path in space."""
        require_space(kind, spec, "a Crazyflie")

    def back(self, files: Mapping[str, bytes]) -> Splined:
        """The motion of the firmware: the polynomials in single precision.

        UsageError if a piece does not end where the next one begins, to within MEET.
        """
        _, *rows = csv.reader(io.StringIO(files[FILE].decode()))
        table = np.array([[float(cell) for cell in row] for row in rows]).astype(np.float32).astype(float)
        length, numbers = table[:, 0], table[:, 1:].reshape(len(table), 4, COEFFICIENTS)[:, :3]
        times = np.concatenate([[0.0], np.cumsum(length)])
        starts = np.stack([numbers[:, :, order] * math.factorial(order) for order in range(ORDERS)])
        ends = np.stack(
            [_ends(piece, seconds) for piece, seconds in zip(numbers, length, strict=True)], axis=1
        )
        gap = np.abs(ends[0, :-1] - starts[0, 1:]).max(initial=0.0)
        if not gap <= MEET:
            raise UsageError(f"pieces of the polynomial miss each other by {gap:.3g} m", where=FILE)
        return Splined(times, np.concatenate([starts, ends[:, -1:]], axis=1))


def _edges(motion: Trajectory) -> tuple[Array, float]:
    """(K,) s between pieces, which include those of the motion, and the error of the pieces, m.

    The part of the motion with the largest error gets one more piece, until the memory is full.
    """
    edges = {0.0, motion.duration}
    for start, _, piece in motion.pieces():
        edges |= {start, min(start + piece.duration, motion.duration)}
    ends = np.array(sorted(edges))
    ends = ends[np.concatenate([[True], np.diff(ends) > 1e-6])]
    if len(ends) - 1 > PIECES:
        raise UsageError(f"the motion has {len(ends) - 1} pieces, a Crazyflie's memory holds {PIECES}")
    counts = np.ones(len(ends) - 1, dtype=int)
    missed = np.array([_fit_error(motion, a, b, 1) for a, b in itertools.pairwise(ends.tolist())])
    while counts.sum() < PIECES:
        worst = int(np.argmax(missed))
        counts[worst] += 1
        missed[worst] = _fit_error(motion, ends[worst], ends[worst + 1], int(counts[worst]))
    parts = [np.linspace(a, b, n + 1)[:-1] for a, b, n in zip(ends, ends[1:], counts, strict=False)]
    # durations are sent in single precision: edges are their sums
    rough = np.diff(np.concatenate([*parts, ends[-1:]])).astype(np.float32).astype(float)
    times = np.concatenate([[0.0], np.cumsum(rough)])
    return np.asarray(np.minimum(times, motion.duration)), float(missed.max())


SAMPLES = 64
"""Number of points of each piece at which it is compared with the motion."""


def _fit_error(motion: Trajectory, start: float, end: float, count: int) -> float:
    """Error, m, of that number of pieces of equal length against the motion from start to end."""
    times = np.linspace(start, end, count + 1)
    pieces = Splined(times - start, motion.motion(times, ORDERS).orders)
    fine = np.linspace(start, end, SAMPLES * count + 1)
    away = pieces.motion(fine - start, 1).orders[0] - motion.motion(fine, 1).orders[0]
    return float(np.abs(away).max())


def _coefficients(times: Array, points: Array) -> Array:
    """(P, k, 8) of 1, t, ..., t^7 on each piece, from position to jerk (4, K, k) at both its ends."""
    from scipy.interpolate import BPoly, PPoly

    curve = PPoly.from_bernstein_basis(BPoly.from_derivatives(times, np.moveaxis(points, 0, 1)))
    return np.moveaxis(curve.c[::-1], 0, -1)


def _row(order: int, powers: Index, t: float) -> Array:
    """(8,) the derivative of that order of 1, t, ..., t^7 at t."""
    falling = np.array([math.perm(int(p), order) for p in powers], dtype=float)
    return np.asarray(falling * t ** np.maximum(powers - order, 0))


def _ends(numbers: Array, t: float) -> Array:
    """(O, k) position to jerk of a piece at its end."""
    powers = np.arange(COEFFICIENTS)
    return np.stack([np.asarray(numbers @ _row(order, powers, t)) for order in range(ORDERS)])


def _text(times: Array, numbers: Array) -> str:
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    names = [f"{axis}^{i}" for axis in ("x", "y", "z", "yaw") for i in range(COEFFICIENTS)]
    lines.writerow(["duration", *names])
    still = [0.0] * COEFFICIENTS
    for seconds, piece in zip(np.diff(times).tolist(), numbers, strict=True):
        lines.writerow([repr(seconds), *map(repr, [*piece.ravel().tolist(), *still])])
    return text.getvalue()


POLY4D = Poly4d()
