"""FourierFamily: Fourier trajectories that are linear in a vector of parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from etude.errors import UsageError
from etude.trajectories.config import FourierConfig
from etude.trajectories.extremes import OVERSAMPLING
from etude.trajectories.fourier import FourierTrajectory, basis, instants, rest_nullspace
from etude.types import Array, Motion

SHORTEST, LONGEST = 10.0, 60.0
"""s, shortest and longest segment whose length is chosen for the robot."""
TINY = 1e-12
"""rad or m: an axis with a smaller range counts as fixed."""


def suited_to(
    config: FourierConfig, lower: Array, upper: Array, velocity: Array, acceleration: Array
) -> FourierConfig:
    """One period of the length that suits a robot's limits (k,), if omega0 was left open.

    With one period per minute a fast robot would use a few per cent of its velocity limits, and its inertia
    would not show. Repeating one short period would give no new information. So a period is as short as the
    axis with the longest range relative to its speed allows, from 10 to 60 s. An axis that swings over its
    range in the middle harmonics then nearly reaches its limits of both position and velocity (or
    acceleration). The recording's `duration` has a whole number of such segments, each a different motion.
    With room for only one, a segment lasts as long as the recording.
    """
    if config.omega0 is not None:
        return config
    half_range, middle = np.maximum(0.5 * (upper - lower), TINY), 0.5 * max(config.harmonics, 2)
    by_velocity = velocity / half_range / middle
    by_acceleration = np.sqrt(acceleration / half_range) / middle
    omega0 = float(np.min(np.minimum(by_velocity, by_acceleration)))
    period = min(max(2.0 * math.pi / omega0, SHORTEST), LONGEST)
    count = max(1, min(round(config.duration / period), math.floor(config.duration / SHORTEST)))
    duration = config.duration / count
    return replace(config, duration=duration, omega0=2.0 * math.pi / duration)


@dataclass(frozen=True, eq=False)
class FourierFamily:
    """All Fourier trajectories of one base frequency, parametrised by a vector (P,).

    Attributes:
        config: the configuration of the family.
        omega0: rad/s; `drawn` gives the family with another value in range.
        basis: (k, 2N+1, P) coefficients of axis j are basis[j] @ p + offset[:, j]; orthonormal columns, one
            axis after the other, each axis's constant term first (where it is free).
        offset: (2N+1, k) coefficients at p = 0: constant terms that are not free.
        samples: samples per degree in `rows`; fewer give a smaller set and a faster search.
    """

    config: FourierConfig
    omega0: float
    basis: Array
    offset: Array
    samples: int = OVERSAMPLING

    @classmethod
    def of(
        cls,
        config: FourierConfig,
        axes: int,
        constants: Sequence[float | None] | None = None,
        samples: int = OVERSAMPLING,
    ) -> FourierFamily:
        """The family of `axes` axes.

        Args:
            config: harmonics, duration, omega0, rest.
            axes: k.
            constants: of each axis the value of its constant term, None where that is free; None: all free.
            samples: see the class.

        Raises:
            UsageError: another number of constants than axes, or one that is not finite.
        """
        fixed = list(constants) if constants is not None else [None] * axes
        if len(fixed) != axes or not all(c is None or math.isfinite(c) for c in fixed):
            raise UsageError(f"{axes} axes need as many constant terms, numbers or None, not {fixed}")
        whole = rest_nullspace(config.harmonics) if config.rest == "nullspace" else None
        whole = np.eye(2 * config.harmonics + 1) if whole is None else whole
        parts = [whole if c is None else whole[:, 1:] for c in fixed]
        basis_ = np.zeros((axes, len(whole), sum(part.shape[1] for part in parts)))
        first = 0
        for j, part in enumerate(parts):
            basis_[j, :, first : first + part.shape[1]] = part
            first += part.shape[1]
        offset = np.zeros((len(whole), axes))
        offset[0] = [0.0 if c is None else c for c in fixed]
        choices = config.choices
        return cls(config, choices[len(choices) // 2], basis_, offset, samples)

    @property
    def size(self) -> int:
        """P, the number of parameters."""
        return int(self.basis.shape[2])

    @property
    def duration(self) -> float:
        """s."""
        return self.config.duration

    def drawn(self, rng: np.random.Generator) -> FourierFamily:
        """The family with a base frequency drawn from its range; itself if there is only one."""
        if len(set(self.config.choices)) == 1:
            return self
        omega0 = self.config.draw_omega0(rng)
        return self if omega0 == self.omega0 else replace(self, omega0=omega0)

    def coefficients(self, p: Array) -> Array:
        """(2N+1, k) coefficients that parameters (P,) choose."""
        return np.asarray((self.basis @ p).T + self.offset)

    def trajectory(self, p: Array) -> FourierTrajectory:
        """The member that parameters (P,) choose."""
        return FourierTrajectory(self.coefficients(p), self.omega0, self.duration, self.config.phase_ramp)

    def parameters(self, trajectory: Any) -> Array:
        """(P,) parameters of a member, or of coefficients (2N+1, k); for others, of the nearest member.

        Raises:
            UsageError: coefficients of another shape.
        """
        is_member = isinstance(trajectory, FourierTrajectory)
        table = np.asarray(trajectory.coefficients if is_member else trajectory, dtype=float)
        if table.shape != self.offset.shape:
            raise UsageError(f"the family's coefficients have shape {self.offset.shape}, not {table.shape}")
        return np.asarray(np.einsum("jcp,cj->p", self.basis, table - self.offset))

    def motion(self, p: Array, t: Array, orders: int = 3) -> Motion:
        """Position and derivatives (O, T, k) of the member p (P,) at times t (T,) s."""
        return Motion(t, self._rows_at(t, orders) @ self.coefficients(p))

    def vjp(self, p: Array, t: Array, gradient: Array) -> Array:  # noqa: ARG002  linear: p does not matter
        """(P,) gradient in the parameters of sum(gradient * orders); gradient (O, T, k)."""
        rows = self._rows_at(t, len(gradient))
        in_table = np.einsum("otc,otj->cj", rows, gradient, optimize=True)
        return np.asarray(np.einsum("jcp,cj->p", self.basis, in_table))

    def rows(self, order: int, degree: int = 1) -> tuple[Array, Array, float]:
        """`bound` of the members, linear in p: rows (k, M, P), offsets (k, M) and kappa.

        kappa leaves room for the proof of the final bytes, which uses other samples: if values at these
        instants are within kappa times a limit, the proof succeeds.
        """
        c = self.config
        whole, kappa = instants(order, degree, c.harmonics, self.omega0, c.phase_ramp, self.samples)
        if self.samples != OVERSAMPLING:
            kappa *= math.cos(math.pi / OVERSAMPLING)
        return np.einsum("mc,jcp->jmp", whole, self.basis), (whole @ self.offset).T, kappa

    def _rows_at(self, t: Array, orders: int) -> Array:
        """(O, T, 2N+1), cached for searches, which use the same times repeatedly."""
        c, t = self.config, np.ascontiguousarray(t, dtype=float)
        return _rows(t.tobytes(), c.harmonics, self.omega0, c.duration, c.phase_ramp, orders)


@lru_cache(maxsize=8)
def _rows(times: bytes, harmonics: int, omega0: float, duration: float, ramp: float, orders: int) -> Array:
    rows = basis(np.frombuffer(times), harmonics, omega0, duration, ramp, orders)
    rows.setflags(write=False)
    return rows
