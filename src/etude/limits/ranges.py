"""Proved ranges of a piece of motion: of coordinates, sizes of vectors, and tilt."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from etude.errors import UnsafeTrajectoryError
from etude.protocols import Trajectory
from etude.trajectories.extremes import OVERSAMPLING, riesz_range
from etude.types import Array, Cone, Margins

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
        sampled: whether the values are the motion's own, and not only what it stays between (on a phase ramp,
            on straight moves): then the least size of a vector is bounded like the largest.
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
    sampled = bool(getattr(piece, "sampled", False))
    return Bound(values[:, axes] + shift, amplitudes[axes] + np.abs(shift), kappa, sampled)


def norm_range(bound: Bound) -> tuple[float, float]:
    """Proved interval of a vector's size, from its square, a polynomial of twice the degree.

    From values that are not samples of the motion nothing is proved of the least size: it may lie between.
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
        rad; pi where the lift is not positive: f cannot tell a cone's two halves.
    """
    across, along = (force.values[:, :2] ** 2).sum(axis=1), force.values[:, 2] ** 2
    sizes = float((force.size[:2] ** 2).sum()), float(force.size[2] ** 2)

    def proved(angle: float) -> bool:
        square = math.tan(angle) ** 2
        f = (across - square * along)[:, None]
        return bool(riesz_range(f, force.kappa, sizes[0] + square * sizes[1])[1][0] <= 0.0)

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
    """(n,) what is kept for the tracking error, and (n,) with which confidence.

    The larger of a fixed margin and that of motions of that form. A fixed one is its owner's word, which is
    assumed until logs speak of it.
    """
    fixed = np.broadcast_to(np.asarray(margin, dtype=float), (len(axes),))
    unmeasured = np.where(fixed > 0.0, 0.0, 1.0)
    table, confidence = margins.get(form, (np.zeros((0, 0)), 1.0))
    if order >= len(table):
        return fixed, unmeasured
    own, sure = table[order][axes], np.broadcast_to(confidence, table.shape)[order][axes]
    return np.fmax(fixed, own), np.where(np.isnan(own), unmeasured, sure)


def slabs(name: str, rows: Array, offset: Array, half: float) -> Cone:
    """|rows p + offset| <= half at M instants; rows (M, P), offset (M,).

    Raises:
        UnsafeTrajectoryError: half is not above 0.
    """
    if not half > 0.0:
        raise UnsafeTrajectoryError(
            f"no motion keeps the limit of {name}: {half:.3g} is left to either side of its middle",
            where=name,
            next_step="Widen the limit, or keep less beside it.",
        )
    return Cone(name, (rows / half)[None], (offset / half)[None])


def method_of(kappa: float, degree: int) -> str:
    """How samples with that kappa prove something, for the certificate."""
    if kappa == 1.0:
        return "values that the motion stays between"
    samples = round(math.pi / math.acos(kappa))
    if degree == 1:
        return f"Riesz bound from {samples} samples per harmonic"
    return f"Riesz bound of twice the degree from {samples} samples per degree"
