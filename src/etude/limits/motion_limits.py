"""Limits of motions: on single axes, on norms of vectors, on a vehicle's tilt. A new one is a class here, or
a function for `lipschitz.py` if it depends on poses alone; a kind of robot lists its own in its `motions.py`.

Each limit is imposed at the family's instants, and shrunk so that it holds at every time. The proof of the
final bytes uses other samples, and cannot fail then either. The factor is kappa for what is linear in the
parameters, and its square root for the size of a vector, whose square has twice the degree.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from etude.errors import UnsafeTrajectoryError
from etude.protocols import Family, Trajectory
from etude.trajectories.extremes import OVERSAMPLING, USABLE_PART, riesz_range
from etude.trajectories.fourier import FourierTrajectory
from etude.types import Array, Cone, Margins, Motion, Proof

STRAYS = "where what was learned is wrong, tracking apart"
STRAYS_HOW = "what the rows say, through the receiver's feedback"
"""Quantity, after the name of the limited one, and method of rows for poses off the planned path."""
SMALLEST = 1e-9
"""Width of an interval, relative to its ends, below which it counts as empty."""
SMALLEST_ROOT = 1e-6
"""rad/s (m/s). Below it the slope of the square root is taken at this value."""
CERTIFIED = math.cos(math.pi / OVERSAMPLING)
"""kappa of the proof of final bytes."""
TILT_STEPS = 50
"""Halvings of the interval that holds the proved tilt."""


@dataclass(frozen=True, eq=False)
class Bound:
    """Samples that bound a vector at all times.

    Attributes:
        values: (M, n). size: (n,) sum of amplitudes, for rounding.
        kappa: max_t |.| <= max |values| / kappa, of each component or, on the finer grid, of quadratic forms.
        sampled: whether the values are samples of the motion itself; then the smallest size of a vector is
            bounded like the largest. On phase ramps and straight moves they only enclose the motion.
    """

    values: Array
    size: Array
    kappa: float
    sampled: bool

    def range(self) -> tuple[Array, Array]:
        """Interval (n,), (n,) that holds each component."""
        return riesz_range(self.values, self.kappa, self.size)


def bound_of(piece: Trajectory, order: int, degree: int, axes: list[int], shift: Array) -> Bound:
    """Bound of some coordinates' derivative of that order, plus a constant shift (n,)."""
    values, amplitudes, kappa = piece.bound(order, degree)
    sampled = isinstance(piece, FourierTrajectory) and piece.sampled
    return Bound(values[:, axes] + shift, amplitudes[axes] + np.abs(shift), kappa, sampled)


def norm_range(bound: Bound) -> tuple[float, float]:
    """Proved interval of a vector's size, from its square, a polynomial of twice the degree.

    Values that are not samples of the motion give no lower bound of the size.
    """
    square, size = (bound.values**2).sum(axis=1), float((bound.size**2).sum())
    low, high = riesz_range(square[:, None], bound.kappa, size)
    least = max(float(low[0]), 0.0) if bound.sampled else 0.0
    return math.sqrt(least), math.sqrt(max(float(high[0]), 0.0))


def largest_tilt(force: Bound, lift: float) -> float:
    """Least angle b for which f = a_x^2 + a_y^2 - tan(b)^2 (a_z + g)^2 <= 0 is proved at all times.

    Args:
        force: bound of a + g z (M, 3), of degree 2.
        lift: proved least a_z + g.

    Returns:
        rad; pi where the lift is not positive: f does not distinguish the two halves of the cone.
    """
    across, along = (force.values[:, :2] ** 2).sum(axis=1), force.values[:, 2] ** 2
    sizes = float((force.size[:2] ** 2).sum()), float(force.size[2] ** 2)

    def proved(angle: float) -> bool:
        square = math.tan(angle) ** 2
        f = (across - square * along)[:, None]
        return bool(riesz_range(f, force.kappa, sizes[0] + square * sizes[1])[1][0] <= 0.0)

    # 1 µrad below a right angle, where the tangent is infinite
    low, high = 0.0, 0.5 * math.pi - 1e-6
    if not lift > 0.0:
        return math.pi
    if not proved(high):
        return 0.5 * math.pi
    for _ in range(TILT_STEPS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if proved(middle) else (middle, high)
    return high


def tracked(
    margin: Array | float, margins: Margins, form: str, order: int, axes: list[int]
) -> tuple[Array, Array]:
    """Tracking margins (n,) and their confidence (n,).

    The larger of the fixed margin and the one learned for that form of motion. A fixed margin counts as
    assumed.
    """
    fixed = np.broadcast_to(np.asarray(margin, dtype=float), (len(axes),))
    unmeasured = np.where(fixed > 0.0, 0.0, 1.0)
    table, confidence = margins.get(form, (np.zeros((0, 0)), 1.0))
    if order >= len(table):
        return fixed, unmeasured
    learned, sure = table[order][axes], np.broadcast_to(confidence, table.shape)[order][axes]
    return np.fmax(fixed, learned), np.where(np.isnan(learned), unmeasured, sure)


def envelope_speed(left: Array, offset: Array, slope: Array, most: Array) -> tuple[Array, Array]:
    """(..., n) largest speed towards an end, min(most, offset + sqrt(slope left)), and how steeply it falls.

    Where the envelope is constant the slope is 0. With a negative offset the slope grows up to the point of
    zero speed. Otherwise it is unbounded at the end, and no motion up to the end can be proved.

    Args:
        left: (..., n) rad (m) to the end. offset, most: (n,) rad/s (m/s). slope: (n,) rad/s^2 (m/s^2).
    """
    root = np.sqrt(slope * np.maximum(left, 0.0))
    speed = np.minimum(most, np.maximum(offset + root, 0.0))
    steep = 0.5 * slope / np.maximum(root, np.maximum(-offset, SMALLEST_ROOT))
    return speed, np.where(offset + root < most, steep, 0.0)


def slabs(name: str, rows: Array, offset: Array, half: float) -> Cone:
    """|rows p + offset| <= half at M instants; rows (M, P), offset (M,).

    Raises:
        UnsafeTrajectoryError: half is not above 0.
    """
    if not half > 0.0:
        raise UnsafeTrajectoryError(
            f"no motion keeps the limit of {name}: {half:.3g} remains on either side of its middle",
            where=name,
            next_step="Enlarge the limit, or reduce the tracking margin.",
        )
    return Cone(name, (rows / half)[None], (offset / half)[None])


def method_of(kappa: float, degree: int) -> str:
    """Name of the proof method from samples with that kappa, for the certificate."""
    if kappa == 1.0:
        return "values that the motion stays between"
    samples = round(math.pi / math.acos(kappa))
    if degree == 1:
        return f"Riesz bound from {samples} samples per harmonic"
    return f"Riesz bound of twice the degree from {samples} samples per degree"


TILT_ROOM = (1.0 - 4.0 * (1.0 - CERTIFIED)) / CERTIFIED
"""Room for rounding in tilt, relative to other limits: its proof bounds a polynomial as large as (1.7 g)^2,
which four times their room covers.
"""


class Convex:
    """Base class of limits without a penalty."""

    quantity: str

    @property
    def name(self) -> str:
        return self.quantity

    def penalty(self, motion: Motion) -> tuple[float, Array] | None:  # noqa: ARG002
        """None: the limit is convex, so cones describe it completely."""
        return None


@dataclass(frozen=True, eq=False)
class AxisLimit(Convex):
    """lower <= d^order/dt^order of each coordinate + shift <= upper.

    Attributes:
        quantity: "position", "velocity", "acceleration", "jerk", "box", "lift", ...
        order: 0 for position, 1 for velocity, ...
        names: of the n axes, as in the certificate.
        lower, upper: (n,) in the coordinate's unit and s.
        axes: their places in the motion; None: the first n.
        shift: constant added to each coordinate, gravity for lift.
        margin: (n,) or one number, subtracted at both ends for the tracking error; a larger learned one wins.
        margins: learned margins, by form of motion.
        rest: for a velocity, whether motions, and each of their pieces, must start and end at rest.
    """

    quantity: str
    order: int
    names: tuple[str, ...]
    lower: Array
    upper: Array
    axes: tuple[int, ...] | None = None
    shift: float = 0.0
    margin: Array | float = 0.0
    margins: Margins = field(default_factory=dict)
    rest: bool = False

    @property
    def places(self) -> list[int]:
        """Indices of the axes in the motion."""
        return list(range(len(self.names)) if self.axes is None else self.axes)

    def inner(self, form: str) -> tuple[Array, Array, Array, Array]:
        """(n,) lower and upper less the margin, the margin, and its confidence."""
        margin, confidence = tracked(self.margin, self.margins, form, self.order, self.places)
        return np.asarray(self.lower) + margin, np.asarray(self.upper) - margin, margin, confidence

    def check_room(self, form: str) -> None:
        """Raise UnsafeTrajectoryError, with the axis and the limit, if some axis has no room to move."""
        low, high, margin, _ = self.inner(form)
        for j, name in enumerate(self.names):
            smallest = SMALLEST * max(1.0, abs(low[j]), abs(high[j])) if self.order == 0 else 0.0
            if not high[j] - low[j] > smallest or not margin[j] >= 0.0:
                _no_room(self.quantity, name, self._text(j, float(margin[j])))

    def _text(self, j: int, margin: float) -> str:
        lower, upper = float(np.asarray(self.lower)[j]), float(np.asarray(self.upper)[j])
        text = f"{upper:g}" if lower == -upper and self.order > 0 else f"{lower:g}..{upper:g}"
        return text + (f" less {margin:g} on both sides" if margin != 0.0 else "")

    def cones(self, family: Family) -> Sequence[Cone]:
        """A slab for each axis whose limits are finite."""
        low, high, _, _ = self.inner(_form(family))
        rows, offset, kappa = family.rows(self.order, 1)
        return [
            slabs(
                f"{self.names[j]}, {self.quantity}",
                rows[i],
                offset[i] + self.shift - 0.5 * (high[j] + low[j]),
                0.5 * kappa * USABLE_PART * (high[j] - low[j]),
            )
            for j, i in enumerate(self.places)
            if math.isfinite(high[j] - low[j])
        ]

    def prove(self, piece: Trajectory) -> Sequence[Proof]:
        """One row for each axis."""
        low, high, margin, confidence = self.inner(piece.form)
        bound = bound_of(piece, self.order, 1, self.places, np.full(len(self.names), self.shift))
        least, most = bound.range()
        how = method_of(bound.kappa, 1)
        table = np.stack([low, high, least, most, margin, confidence], axis=1).tolist()
        return [
            Proof(name, self.quantity, a, b, c, d, how, tracking_margin=tracking, confidence=sure)
            for name, (a, b, c, d, tracking, sure) in zip(self.names, table, strict=True)
        ]

    def blocked(self, form: str, pose: Array) -> str:
        """For positions, the first axis beyond its limit less the margin; otherwise ""."""
        if self.order:
            return ""
        low, high, _, _ = self.inner(form)
        at = pose[self.places] + self.shift
        beyond = np.flatnonzero((at < low) | (at > high))
        return f"the {self.quantity} limit of {self.names[beyond[0]]}" if len(beyond) else ""

    def strayed(self, places: Array, off: Array) -> Sequence[Proof]:
        """One row for each axis, from a motion's poses (T, k) and their possible errors (T, k).

        The limit here is the full one, without a margin subtracted. Where the plan itself leaves no room,
        as straight up from the ground or down to it, the ground does not count as a limit.
        """
        at = places[:, self.places]
        low, high = np.asarray(self.lower) + self.margin, np.asarray(self.upper) - self.margin
        by = np.where((at >= low - SMALLEST) & (at <= high + SMALLEST), off[:, self.places], 0.0)
        ends = np.minimum(self.lower, at.min(axis=0)), np.maximum(self.upper, at.max(axis=0))
        table = np.stack([*ends, (at - by).min(axis=0), (at + by).max(axis=0)], axis=1).tolist()
        quantity = f"{self.quantity}, {STRAYS}"
        return [
            Proof(name, quantity, a, b, c, d, STRAYS_HOW, "sampled")
            for name, (a, b, c, d) in zip(self.names, table, strict=True)
        ]

    def of_motion(self, motion: Motion) -> Array:
        """(T, n) the coordinates' derivative, shifted."""
        return np.asarray(motion.orders[self.order][:, self.places] + self.shift)


@dataclass(frozen=True, eq=False)
class NormLimit(Convex):
    """lower <= |d^order/dt^order of some coordinates + shift| <= upper: speed, a cylinder, thrust.

    The lower bound is not convex, but a linear bound implies it: cones require the component along `shift`
    to be at least `lower`. To make this a slab, they also limit it as far above |shift| as below.

    Attributes:
        quantity: "speed", "radius", "thrust", ...
        order: 0 for position, ...
        axes: places of the coordinates in the motion.
        upper: largest size; lower: smallest size, or None. `lower` needs a shift.
        shift: (len(axes),) added before the size is taken, gravity for thrust; empty for none.
        axis: name in the certificate.
        margin, margins, rest: see `AxisLimit`; for several axes, the norm of their margins.
        looks_at, not_verified: topics that the limit also covers, see `abilities.SupportsCoverage`.
    """

    quantity: str
    order: int
    axes: tuple[int, ...]
    upper: float
    lower: float | None = None
    shift: tuple[float, ...] = ()
    axis: str = "vehicle"
    margin: float = 0.0
    margins: Margins = field(default_factory=dict)
    rest: bool = False
    looks_at: tuple[str, ...] = ()
    not_verified: tuple[str, ...] = ()

    @property
    def _shift(self) -> Array:
        return np.array(self.shift if self.shift else (0.0,) * len(self.axes))

    def inner(self, form: str) -> tuple[float | None, float, float, float]:
        """Lower and upper less the margin, the margin, and its confidence."""
        learned, confidence = tracked(0.0, self.margins, form, self.order, list(self.axes))
        margin = max(self.margin, float(np.linalg.norm(learned)))
        sure = 0.0 if self.margin > 0.0 and not np.any(learned > 0.0) else float(confidence.min())
        return None if self.lower is None else self.lower + margin, self.upper - margin, margin, sure

    def check_room(self, form: str) -> None:
        """Raise UnsafeTrajectoryError if rest in the middle is not inside the limit."""
        least, most, margin, _ = self.inner(form)
        needed = float(np.linalg.norm(self._shift))
        fits = (least is None or (least < needed)) and needed < most and margin >= 0.0
        if not fits or not math.isfinite(margin):
            below = "" if self.lower is None else f"{self.lower:g}.."
            offset = f", {needed:.4g} at rest included" if needed > 0.0 else ""
            less = f" less {margin:g}" if margin != 0.0 else ""
            _no_room(self.quantity, self.axis, f"{below}{self.upper:g}{less}{offset}")

    def cones(self, family: Family) -> Sequence[Cone]:
        """A ball, and a slab along the shift if there is a lower bound."""
        least, most, _, _ = self.inner(_form(family))
        rows, offset, kappa = family.rows(self.order, 2)
        places, shift, radius = list(self.axes), self._shift, math.sqrt(kappa * USABLE_PART) * most
        name = f"{self.axis}, {self.quantity}"
        ball = Cone(name, rows[places] / radius, (offset[places] + shift[:, None]) / radius)
        if least is None:
            return [ball]
        size = float(np.linalg.norm(shift))
        rows, offset, kappa = family.rows(self.order, 1)
        along, moved = (np.tensordot(shift / size, part[places], 1) for part in (rows, offset))
        return [ball, slabs(name, along, moved, kappa * USABLE_PART * (size - least))]

    def prove(self, piece: Trajectory) -> Sequence[Proof]:
        """One row; without a lower bound its interval is -upper..upper, as for an axis."""
        least, most, margin, confidence = self.inner(piece.form)
        bound = bound_of(piece, self.order, 2, list(self.axes), self._shift)
        down, up = norm_range(bound)
        how = method_of(bound.kappa, 2)
        if least is None:
            ends = (-most, most, -up, up)
        else:
            low, high = bound_of(piece, self.order, 1, list(self.axes), self._shift).range()
            ends = (least, most, max(down, float(np.max(low)), float(np.max(-high))), up)
        return [Proof(self.axis, self.quantity, *ends, how, tracking_margin=margin, confidence=confidence)]

    def strayed(self, places: Array, off: Array) -> Sequence[Proof]:
        """One row, see `AxisLimit.strayed`."""
        axes = list(self.axes)
        most = float((np.linalg.norm(places[:, axes], axis=1) + np.linalg.norm(off[:, axes], axis=1)).max())
        ends = -self.upper, self.upper, -most, most
        return [Proof(self.axis, f"{self.quantity}, {STRAYS}", *ends, STRAYS_HOW, "sampled")]

    def of_motion(self, motion: Motion) -> Array:
        """(T, 1) the size."""
        vector = motion.orders[self.order][:, list(self.axes)] + self._shift
        return np.asarray(np.linalg.norm(vector, axis=1)[:, None])


@dataclass(frozen=True, eq=False)
class TiltLimit(Convex):
    """Angle of a + g z from the vertical at most `angle`: |a_xy| <= tan(angle) (g + a_z).

    The cones impose it for a_z and for -a_z, since a bound for all times needs both signs. This excludes
    motions that climb hard and lean far at once, although the limit allows them. No proof is possible where
    the vertical component comes near zero, so it is kept above `least`.

    Attributes:
        angle: rad, in 0..pi/2.
        gravity: g, m/s^2.
        axes: places of x, y, z in the motion.
        least: smallest vertical component of a + g z, as a fraction of g.
        axis, quantity: as in the certificate.
    """

    angle: float
    gravity: float
    axes: tuple[int, int, int] = (0, 1, 2)
    least: float = 0.3
    axis: str = "vehicle"
    quantity: str = "tilt"
    order: int = 2
    rest: bool = False

    def check_room(self, form: str) -> None:  # noqa: ARG002
        """Raise UnsafeTrajectoryError unless the angle is in 0..pi/2."""
        if not 0.0 < self.angle < 0.5 * math.pi:
            _no_room(self.quantity, self.axis, f"{self.angle:g} rad (it must be in 0..pi/2)")

    def cones(self, family: Family) -> Sequence[Cone]:
        """|a_xy| <= tan(angle) (shrunk g -+ a_z), both signs, and the slab that keeps a_z + g positive."""
        rows, offset, kappa = family.rows(self.order, 2)
        near, near_offset, near_kappa = family.rows(self.order, 1)
        x, y, z = self.axes
        name = f"{self.axis}, {self.quantity}"
        cones = []
        for sign in (-1.0, 1.0):
            reach = kappa * TILT_ROOM * USABLE_PART * self.gravity + sign * offset[z]  # (M,)
            across = math.tan(self.angle) * reach
            tips = sign * rows[z] / reach[:, None]
            cones.append(Cone(name, rows[[x, y]] / across[:, None], offset[[x, y]] / across, tips))
        room = near_kappa * USABLE_PART * (1.0 - self.least) * self.gravity
        return [*cones, slabs(name, near[z], near_offset[z], room)]

    def prove(self, piece: Trajectory) -> Sequence[Proof]:
        """One row, written as -angle..angle."""
        shift = np.array([0.0, 0.0, self.gravity])
        lift = float(bound_of(piece, self.order, 1, list(self.axes), shift).range()[0][2])
        bound = bound_of(piece, self.order, 2, list(self.axes), shift)
        largest = largest_tilt(bound, lift)
        limit = self.angle
        return [Proof(self.axis, self.quantity, -limit, limit, -largest, largest, method_of(bound.kappa, 2))]

    def of_motion(self, motion: Motion) -> Array:
        """(T, 1) rad."""
        return self.of_acceleration(motion.orders[self.order])[:, None]

    def of_acceleration(self, acceleration: Array) -> Array:
        """(T,) rad of accelerations (T, k)."""
        force = acceleration[:, list(self.axes)]
        across = np.hypot(force[:, 0], force[:, 1])
        return np.asarray(np.arctan2(across, force[:, 2] + self.gravity))


def _form(family: Family) -> str:
    """The form of the family's members; margins depend on it."""
    return family.trajectory(np.zeros(family.size)).form


def _no_room(quantity: str, axis: str, text: str) -> None:
    raise UnsafeTrajectoryError(
        f"the {quantity} limit {text} of '{axis}' leaves no room for motion",
        where=f"{axis}, {quantity}",
        next_step="Enlarge the limit, or remove the axis from the robot's description.",
    )
