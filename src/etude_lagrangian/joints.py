"""Columns of the joints' positions, velocities and accelerations, as the compiled sweeps take them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from etude.errors import UsageError
from etude.types import Array, Column

LENGTHS = ("m", "mm")
"""Units of a slide's position."""


@dataclass(frozen=True)
class Joints:
    """J joints from base to tip, in the columns of the inputs.

    Attributes:
        positions, speeds, accelerations: (J,) columns of each joint's q, w and u, unscaled.
        slides: (J,) whether a joint is prismatic.
    """

    positions: tuple[int, ...]
    speeds: tuple[int, ...]
    accelerations: tuple[int, ...]
    slides: tuple[bool, ...]

    def __post_init__(self) -> None:
        every = (*self.positions, *self.speeds, *self.accelerations)
        counts = {len(self.positions), len(self.speeds), len(self.accelerations), len(self.slides)}
        if len(counts) != 1 or not every or len(set(every)) != len(every) or min(every) < 0:
            raise UsageError(f"each joint needs one column of q, of qd and of qdd, got {self}")

    @property
    def count(self) -> int:
        """J."""
        return len(self.positions)

    def packed(self, X: Array) -> Array:
        """(4, J, n) of inputs X (n, D): sin q, cos q, w, u; of a slide q and 1 in place of the first two.

        Raises:
            UsageError: X lacks a column.
        """
        X = np.asarray(X, dtype=float)
        width = 1 + max(*self.positions, *self.speeds, *self.accelerations)
        if X.ndim != 2 or X.shape[1] < width:
            raise UsageError(f"a kernel on column {width - 1} needs more than inputs of shape {X.shape}")
        q = X[:, self.positions].T
        slides = np.array(self.slides)[:, None]
        F = np.empty((4, self.count, len(X)))
        F[0], F[1] = np.where(slides, q, np.sin(q)), np.where(slides, 1.0, np.cos(q))
        F[2], F[3] = X[:, self.speeds].T, X[:, self.accelerations].T
        return F

    def pulled(self, F: Array, dF: Array, width: int) -> Array:
        """Gradient (n, width) in the inputs of what has the gradient dF in their packed form F."""
        out = np.zeros((F.shape[2], width))
        cosine_slope = np.where(np.array(self.slides)[:, None], 0.0, -F[0])
        out[:, self.positions] = (dF[0] * F[1] + dF[1] * cosine_slope).T
        out[:, self.speeds], out[:, self.accelerations] = dF[2].T, dF[3].T
        return out


def joints_of(columns: Sequence[Column]) -> tuple[Joints, tuple[str, ...]]:
    """The joints among these columns, and their names: the parts of the first three channels.

    Raises:
        UsageError: there are no three channels, or they have other parts.
    """
    plain = [(i, column) for i, column in enumerate(columns) if not column[3]]
    channels = list(dict.fromkeys(channel for _, (channel, *_) in plain))[:3]
    places = [tuple(i for i, (channel, *_) in plain if channel == name) for name in channels]
    parts = [tuple(columns[i][1] for i in group) for group in places]
    if len(channels) < 3 or any(names != parts[0] for names in parts):
        raise UsageError(
            "the Lagrangian prior needs position, velocity and acceleration of the same joints",
            where=f"inputs {', '.join(channels) or 'none'}",
            next_step="Use another kernel, such as kernel = 'ard_se'.",
        )
    slides = tuple(columns[i][2] in LENGTHS for i in places[0])
    return Joints(places[0], places[1], places[2], slides), parts[0]
