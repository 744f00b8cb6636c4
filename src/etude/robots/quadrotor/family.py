"""FlightFamily: which flights may be proposed, thesis (3.3), and the numbers that choose one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError
from etude.trajectories.fourier import FourierTrajectory, rest_nullspace

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FlightFamily:
    """Fourier flights of one base frequency: x and y without a constant term, z with one (thesis (3.3)).

    Attributes:
        harmonics: N; at least 2 with `rest`.
        duration: s.
        omega0: rad/s; None for 2 pi/duration, one period.
        start: how the vehicle begins: "hover", at rest at the first position, so that the plan's first
            velocity is a step (the thesis); or "moving", with the plan's velocity. The plan is the same.
        rest: whether the plan itself starts and ends at rest (two equalities per axis, whole periods).
        free_centre: whether x and y have a constant term too, which the limits then bound.
        centre: constant terms of x and y where they are not free, m.

    Raises:
        UsageError: values out of range, or rest without a whole number of periods.
    """

    harmonics: int = 2
    duration: float = 30.0
    omega0: float | None = None
    start: Literal["hover", "moving"] = "hover"
    rest: bool = False
    free_centre: bool = False
    centre: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if self.start not in ("hover", "moving"):
            raise UsageError(f"a flight starts in 'hover' or 'moving', not {self.start!r}")
        if not (math.isfinite(self.duration) and self.duration > 0.0):
            raise UsageError(f"the duration must be a positive number of seconds, not {self.duration}")
        if self.harmonics < 1 or not (math.isfinite(self.frequency) and self.frequency > 0.0):
            raise UsageError(
                f"a family needs harmonics >= 1 and omega0 > 0, not {self.harmonics}, {self.frequency}"
            )
        if not all(math.isfinite(c) for c in self.centre):
            raise UsageError(f"the centre must be two finite numbers in m, not {self.centre}")
        periods = self.frequency * self.duration / (2.0 * math.pi)
        if self.rest and abs(periods - max(round(periods), 1)) > 1e-9 * periods:
            raise UsageError(
                f"a flight at rest at both ends needs whole periods, not {periods:.4g}",
                next_step="Change omega0 or the duration.",
            )
        if self.rest:
            rest_nullspace(self.harmonics)

    @property
    def frequency(self) -> float:
        """omega0, rad/s."""
        return 2.0 * math.pi / self.duration if self.omega0 is None else float(self.omega0)

    @cached_property
    def basis(self) -> Array:
        """(3, 2N+1, P): the coefficients of axis j are basis[j] @ parameters, plus the fixed centre.

        Orthonormal columns, one axis after the other.
        """
        whole = rest_nullspace(self.harmonics) if self.rest else np.eye(2 * self.harmonics + 1)
        if self.rest:
            # the constant term is free in the null space: a column of its own, the rest without it
            left = np.linalg.svd(whole[1:])[0][:, : whole.shape[1] - 1]
            whole = np.zeros((len(whole), whole.shape[1]))
            whole[0, 0] = 1.0
            whole[1:, 1:] = left
        horizontal = whole if self.free_centre else whole[:, 1:]
        parts = (horizontal, horizontal, whole)
        out = np.zeros((3, len(whole), sum(part.shape[1] for part in parts)))
        first = 0
        for j, part in enumerate(parts):
            out[j, :, first : first + part.shape[1]] = part
            first += part.shape[1]
        return out

    @property
    def size(self) -> int:
        """P, the number of parameters."""
        return int(self.basis.shape[2])

    @property
    def offset(self) -> Array:
        """(2N+1, 3) coefficients at parameters zero."""
        out = np.zeros((2 * self.harmonics + 1, 3))
        if not self.free_centre:
            out[0, :2] = self.centre
        return out

    def coefficients(self, parameters: Array) -> Array:
        """(2N+1, 3) coefficients of the flight that parameters (P,) choose."""
        return np.asarray((self.basis @ parameters).T + self.offset)

    def parameters(self, coefficients: Array) -> Array:
        """(P,) parameters of a member of the family; the nearest member's if it is none."""
        return np.asarray(np.einsum("jcp,cj->p", self.basis, coefficients - self.offset))

    def pull(self, gradient: Array) -> Array:
        """(P,) gradient in the parameters from a gradient (2N+1, 3) in the coefficients."""
        return np.asarray(np.einsum("jcp,cj->p", self.basis, gradient))

    def trajectory(self, parameters: Array) -> FourierTrajectory:
        """The flight that parameters (P,) choose."""
        return FourierTrajectory(self.coefficients(parameters), self.frequency, self.duration)
