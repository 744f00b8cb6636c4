"""Fourier trajectories, thesis (3.5): position and every derivative, linear in the coefficients."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from etude.errors import UsageError
from etude.protocols import Trajectory
from etude.shown import Picture, picture_of
from etude.trajectories.exact_json import to_text
from etude.trajectories.series import basis, instants
from etude.types import Array, Motion


@dataclass(frozen=True, eq=False)
class FourierTrajectory:
    """Truncated Fourier series of thesis (3.5), the same omega0 for all axes.

    q_j(t) = q0_j + sum_i a_ij/(w0 i) sin(w0 i theta) - b_ij/(w0 i) cos(w0 i theta), theta = theta(t) in s.

    Attributes:
        coefficients: (2N+1, k) rows [q0, a_1..a_N, b_1..b_N]; q0 in rad (m), a and b in rad/s (m/s).
        omega0: base frequency, rad/s.
        duration: s.
        ramp: s; 0 for theta = t, else the length of the phase ramps at both ends (see `ramp.phase`).

    Raises:
        UsageError: wrong shape, values not finite, omega0 or duration <= 0, ramps longer than the whole.
    """

    coefficients: Array
    omega0: float
    duration: float
    ramp: float = 0.0

    def __post_init__(self) -> None:
        table = np.array(self.coefficients, dtype=float)
        if table.ndim != 2 or table.shape[0] < 3 or table.shape[0] % 2 == 0 or table.shape[1] < 1:
            raise UsageError(f"coefficients have shape {table.shape}, not (2N+1, axes) with N >= 1")
        if not np.all(np.isfinite(table)):
            raise UsageError("a Fourier coefficient is not a finite number")
        for name in ("omega0", "duration", "ramp"):
            object.__setattr__(self, name, float(getattr(self, name)))
        check_times(self.omega0, self.duration, self.ramp)
        table.setflags(write=False)
        object.__setattr__(self, "coefficients", table)

    @property
    def form(self) -> str:
        """What its file says it is, and what tracking margins are kept for."""
        return "fourier"

    @property
    def axes(self) -> int:
        """k."""
        return int(self.coefficients.shape[1])

    @property
    def harmonics(self) -> int:
        """N."""
        return (len(self.coefficients) - 1) // 2

    @property
    def sampled(self) -> bool:
        """Whether the values of `bound` are its own, and not only what a phase ramp stays between."""
        return self.ramp == 0.0

    def pieces(self) -> Sequence[tuple[float, str, Trajectory]]:
        """Itself, one segment from 0 s on."""
        return ((0.0, "segment", self),)

    def motion(self, t: Array, orders: int = 3) -> Motion:
        """Position and exact derivatives at times t (T,) s; at rest outside [0, duration].

        Args:
            t: (T,) s.
            orders: O; any number without a phase ramp, up to 4 (jerk) with one.
        """
        t = np.asarray(t, dtype=float)
        rows = basis(t, self.harmonics, self.omega0, self.duration, self.ramp, orders)
        return Motion(t, rows @ self.coefficients)

    def bound(self, order: int, degree: int = 1) -> tuple[Array, Array, float]:
        """Values (M, k) of that derivative, amplitudes (k,) for rounding, kappa; see `series.instants`."""
        rows, kappa = instants(order, degree, self.harmonics, self.omega0, self.ramp)
        return rows @ self.coefficients, np.abs(rows).max(axis=0) @ np.abs(self.coefficients), kappa

    def slowed(self, factor: float) -> FourierTrajectory:
        """The same path in `factor` times the time."""
        table = self.coefficients.copy()
        table[1:] /= factor
        return FourierTrajectory(table, self.omega0 / factor, self.duration * factor, self.ramp * factor)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, FourierTrajectory):
            return NotImplemented
        mine, theirs = (self.omega0, self.duration, self.ramp), (other.omega0, other.duration, other.ramp)
        return mine == theirs and np.array_equal(self.coefficients, other.coefficients)

    def __hash__(self) -> int:
        return hash((self.coefficients.tobytes(), self.omega0, self.duration, self.ramp))

    def plot(self, path: str | Path | None = None) -> Picture:
        """Motion over time: shown by a notebook, and saved as SVG if there is a path."""
        return picture_of("trajectory", self, path)

    def to_json(self) -> str:
        """The exact trajectory as JSON text; every float reads back to the same bits."""
        names = ("coefficients", "omega0", "duration", "ramp")
        return to_text(self.form, {name: getattr(self, name) for name in names})


def check_times(omega0: float, duration: float, ramp: float) -> None:
    """UsageError unless 0 < omega0, 0 < duration and two ramps fit into it."""
    if not (math.isfinite(omega0) and omega0 > 0.0):
        raise UsageError(f"omega0 must be a positive number of rad/s, not {omega0}")
    if not (math.isfinite(duration) and duration > 0.0):
        raise UsageError(f"the duration must be a positive number of seconds, not {duration}")
    if not (math.isfinite(ramp) and 0.0 <= 2.0 * ramp <= duration):
        raise UsageError(f"two ramps of {ramp} s do not fit into {duration} s")
