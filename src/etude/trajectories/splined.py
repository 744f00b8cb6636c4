"""Curves that a receiver plays between points: lines, cubics, quintics, septics, or steps."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from etude.errors import UsageError
from etude.protocols import Trajectory
from etude.types import Array, Motion

if TYPE_CHECKING:
    from etude._runtime.pictures import Picture

FORM = "splined"
HALVINGS = 3
"""Halvings of each piece before its control points bound it. Those of a quintic then exceed it by at most
1/64 of its bend."""
CURVES = {1: "lines", 2: "cubics", 3: "quintics", 4: "septics"}


@dataclass(frozen=True, eq=False)
class Splined:
    """The curve through points with given derivatives: O orders give pieces of degree 2 O - 1.

    A joint trajectory controller interpolates positions by lines, positions and velocities by cubics, and
    with accelerations by quintics; a Crazyflie plays septics. An autopilot holds each order of a set-point
    separately until the next set-point.

    Attributes:
        times: (K,) s, increasing, from 0.
        points: (O, K, k) position and derivatives at these times; 1 <= O <= 4.
        held: whether each point is held until the next, instead of a curve through them.
        like: form of the motion that was sent, whose tracking margins apply here, too; "" for none.

    Raises:
        UsageError: wrong shapes, values that are not finite, times that do not increase from 0.
    """

    times: Array
    points: Array
    held: bool = False
    like: str = ""

    def __post_init__(self) -> None:
        times, points = np.array(self.times, dtype=float), np.array(self.points, dtype=float)
        if times.ndim != 1 or len(times) < 2 or points.ndim != 3 or points.shape[1] != len(times):
            raise UsageError(f"{points.shape} points do not belong to {times.shape} times")
        if not 1 <= len(points) <= len(CURVES):
            raise UsageError(f"points have 1 to {len(CURVES)} orders, not {len(points)}")
        if not (np.isfinite(times).all() and np.isfinite(points).all()):
            raise UsageError("a point or its time is not a finite number")
        if times[0] != 0.0 or not np.all(np.diff(times) > 0.0):
            raise UsageError("the times of points must increase from 0")
        for name, table in (("times", times), ("points", points)):
            table.setflags(write=False)
            object.__setattr__(self, name, table)

    @property
    def form(self) -> str:
        """Form that tracking margins depend on."""
        return self.like or FORM

    @property
    def axes(self) -> int:
        """k."""
        return int(self.points.shape[2])

    @property
    def duration(self) -> float:
        return float(self.times[-1])

    @property
    def bounded(self) -> int:
        """Number of orders with a bound: one more than the given ones; if held, the given ones."""
        return len(self.points) + (0 if self.held else 1)

    @property
    def curve(self) -> str:
        """Name of the curve, in a word."""
        return "steps" if self.held else CURVES[len(self.points)]

    def pieces(self) -> Sequence[tuple[float, str, Trajectory]]:
        """Itself, one segment from 0 s on."""
        return ((0.0, "segment", self),)

    def motion(self, t: Array, orders: int = 3) -> Motion:
        """Position and derivatives at times t (T,) s; where they jump, those of the piece that begins there.

        At rest outside [0, duration]. Derivatives that a held point does not give are zero.
        """
        t = np.asarray(t, dtype=float)
        k = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2)
        inside = (t >= 0.0) & (t <= self.duration)
        out = np.zeros((orders, len(t), self.axes))
        if self.held:
            k = np.where(t >= self.duration, len(self.times) - 1, k)
            defined = min(orders, len(self.points))
            out[:defined] = self.points[:defined, k]
        else:
            length = np.diff(self.times)[k]
            u = np.clip((t - self.times[k]) / length, 0.0, 1.0)
            control = self._control()[:, k]
            for order in range(min(orders, len(control))):
                out[order] = _casteljau(_derived(control, order, length), u)
        out[1:] *= inside[:, None]
        return Motion(t, out)

    def bound(self, order: int, degree: int = 1) -> tuple[Array, Array, float]:
        """Values (M, k) whose convex hull contains that derivative: control points, kappa 1.

        So they bound every convex function: coordinates, sizes of vectors, tilt.

        Raises:
            UsageError: an order that jumps without bound, or a degree other than 1 and 2.
        """
        if not 0 <= order < self.bounded or degree not in (1, 2):
            raise UsageError(f"nothing bounds derivative {order} of {self.curve}")
        if self.held:
            values = self.points[order]
        else:
            control = _derived(self._control(), order, np.diff(self.times))
            for _ in range(HALVINGS):
                control = _halved(control)
            values = control.reshape(-1, self.axes)
        return values, np.abs(values).max(axis=0), 1.0

    def slowed(self, factor: float) -> Splined:
        """The same curve in `factor` times the time."""
        scale = factor ** -np.arange(len(self.points), dtype=float)
        return Splined(self.times * factor, self.points * scale[:, None, None], self.held, self.like)

    def plot(self, path: str | Path | None = None) -> Picture:
        """Motion over time: shown by a notebook, and saved as SVG if there is a path."""
        from etude._runtime.pictures import picture_of

        return picture_of("trajectory", self, path)

    def to_json(self) -> str:
        """The exact points as JSON text; every float reads back to the same bits."""
        table = {"times": self.times.tolist(), "points": self.points.tolist()}
        return json.dumps({"form": FORM, **table, "held": self.held, "like": self.like}, indent=1) + "\n"

    def _control(self) -> Array:
        """(n + 1, K - 1, k) control points of Bernstein polynomials on [0, 1], n = 2 O - 1.

        p^(j)(0) = n!/(n - j)! of the j-th forward difference of the first ones, and likewise at the end.
        """
        orders, n = len(self.points), 2 * len(self.points) - 1
        length = np.diff(self.times)[:, None]
        out = np.zeros((n + 1, len(self.times) - 1, self.axes))
        for i in range(orders):
            for j in range(i + 1):
                share = math.comb(i, j) * math.factorial(n - j) / math.factorial(n) * length**j
                out[i] += share * self.points[j, :-1]
                out[n - i] += (-1) ** j * share * self.points[j, 1:]
        return out


def _derived(control: Array, order: int, length: Array) -> Array:
    """Control points of a derivative in time, of pieces that last `length` (P,) s."""
    for _ in range(order):
        n = len(control) - 1
        control = n * np.diff(control, axis=0) / length[:, None] if n else np.zeros_like(control)
    return control


def _casteljau(control: Array, u: Array) -> Array:
    """(P, k) values of P polynomials with control points (n + 1, P, k) at u (P,)."""
    while len(control) > 1:
        control = control[:-1] + u[:, None] * (control[1:] - control[:-1])
    return np.asarray(control[0])


def _halved(control: Array) -> Array:
    """(n + 1, 2 P, k) control points of both halves of each piece."""
    left, right = [control[0]], [control[-1]]
    while len(control) > 1:
        control = 0.5 * (control[:-1] + control[1:])
        left.append(control[0])
        right.append(control[-1])
    return np.concatenate([np.stack(left), np.stack(right[::-1])], axis=1)
