"""Fourier trajectories, thesis (3.5): q, qd, qdd and jerk, linear in the coefficients."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError
from etude.trajectories.json_text import from_text, to_text
from etude.trajectories.ramp import phase
from etude.trajectories.samples import TrajectorySamples

Array = NDArray[np.float64]


def series(angle: Array, harmonics: int, omega0: float) -> tuple[Array, Array, Array, Array]:
    """Rows of the series of thesis (3.5) and of its three time derivatives at phase angles omega0 * theta.

    Args:
        angle: (T,) rad.
        harmonics: N.
        omega0: base frequency, rad/s.

    Returns:
        Four arrays (T, 2N+1), to be multiplied with coefficients [q0, a_1..a_N, b_1..b_N].
    """
    i = np.arange(1, harmonics + 1)
    sine, cosine = np.sin(np.outer(angle, i)), np.cos(np.outer(angle, i))
    w = omega0 * i
    one, none = np.ones((len(angle), 1)), np.zeros((len(angle), 1))
    return (
        np.hstack([one, sine / w, -cosine / w]),  # (3.5): a_i/(w0 i) sin - b_i/(w0 i) cos, product form
        np.hstack([none, cosine, sine]),
        np.hstack([none, -w * sine, w * cosine]),
        np.hstack([none, -w * w * cosine, -w * w * sine]),
    )


def _along_ramp(
    rows: tuple[Array, ...], rates: tuple[Array, Array, Array]
) -> tuple[Array, Array, Array, Array]:
    """Chain rule: derivatives in t from derivatives in theta."""
    p0, p1, p2, p3 = rows
    r1, r2, r3 = (rate[:, None] for rate in rates)
    return p0, p1 * r1, p2 * r1**2 + p1 * r2, p3 * r1**3 + 3.0 * p2 * r1 * r2 + p1 * r3


def basis(
    t: Array, harmonics: int, omega0: float, duration: float, ramp: float = 0.0
) -> tuple[Array, Array, Array, Array]:
    """Rows that give q, qd, qdd, qddd at times t (T,) from the coefficients: four arrays (T, 2N+1)."""
    theta, *rates = phase(t, duration, ramp)
    return _along_ramp(series(omega0 * theta, harmonics, omega0), (rates[0], rates[1], rates[2]))


def basis_omega0_derivative(
    t: Array, harmonics: int, omega0: float, duration: float, ramp: float = 0.0
) -> tuple[Array, Array, Array]:
    """Derivatives of the rows of q, qd, qdd with respect to omega0: three arrays (T, 2N+1)."""
    theta, *rates = phase(t, duration, ramp)
    p0, p1, p2, p3 = series(omega0 * theta, harmonics, omega0)
    # With phi = w0 theta: p0 = P(phi)/w0, p1 = P'(phi), p2 = w0 P''(phi): d/dw0 = theta/w0 d/dtheta + ...
    shift = (theta / omega0)[:, None]
    p0 = np.hstack([np.zeros((len(theta), 1)), p0[:, 1:]])
    moved = (shift * p1 - p0 / omega0, shift * p2, shift * p3 + p2 / omega0, np.zeros_like(p3))
    dq, dqd, dqdd, _ = _along_ramp(moved, (rates[0], rates[1], rates[2]))
    return dq, dqd, dqdd


def rest_constraints(harmonics: int) -> Array:
    """(2, 2N+1) rows C with C x = 0 for zero velocity and zero acceleration at t = 0 (scaled by 1/omega0)."""
    i = np.arange(1, harmonics + 1, dtype=float)
    rows = np.zeros((2, 2 * harmonics + 1))
    rows[0, 1 : harmonics + 1] = 1.0  # qd(0) = sum a_i
    rows[1, harmonics + 1 :] = i  # qdd(0) / w0 = sum i b_i
    return rows


def rest_nullspace(harmonics: int, omega0: float = 1.0) -> Array:
    """Orthonormal basis Z (2N+1, 2N-1) of the coefficients that start at rest: sum a_i = 0, sum i b_i = 0.

    The trajectory also ends at rest when its duration is a whole number of periods 2 pi/omega0.
    The equalities do not depend on omega0 in the product form of thesis (3.5).

    Raises:
        UsageError: fewer than two harmonics; only rest itself would be left.
    """
    if harmonics < 2 or omega0 <= 0.0:
        raise UsageError(
            f"rest by equalities needs at least 2 harmonics and omega0 > 0, not {harmonics}, {omega0}",
            next_step="Use rest = 'ramp' instead.",
        )
    _, _, right = np.linalg.svd(rest_constraints(harmonics))
    return np.ascontiguousarray(right[2:].T)


@dataclass(frozen=True, eq=False)
class FourierTrajectory:
    """Truncated Fourier series of thesis (3.5), the same omega0 for all joints.

    q_j(t) = q0_j + sum_i a_ij/(w0 i) sin(w0 i theta) - b_ij/(w0 i) cos(w0 i theta), theta = theta(t) in s.

    Attributes:
        coefficients: (2N+1, dof) rows [q0, a_1..a_N, b_1..b_N]; q0 in rad (m), a and b in rad/s (m/s).
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
            raise UsageError(f"coefficients have shape {table.shape}, not (2N+1, joints) with N >= 1")
        if not np.all(np.isfinite(table)):
            raise UsageError("a Fourier coefficient is not a finite number")
        for name in ("omega0", "duration", "ramp"):
            object.__setattr__(self, name, float(getattr(self, name)))
        _check_times(self.omega0, self.duration, self.ramp)
        table.setflags(write=False)
        object.__setattr__(self, "coefficients", table)

    @property
    def dof(self) -> int:
        return int(self.coefficients.shape[1])

    @property
    def harmonics(self) -> int:
        return (len(self.coefficients) - 1) // 2

    def sample(self, t: Array) -> TrajectorySamples:
        """Positions and exact derivatives at times t (T,) in s; at rest outside [0, duration]."""
        t = np.asarray(t, dtype=float)
        rows = basis(t, self.harmonics, self.omega0, self.duration, self.ramp)
        return TrajectorySamples(t, *(r @ self.coefficients for r in rows))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, FourierTrajectory):
            return NotImplemented
        mine, theirs = (self.omega0, self.duration, self.ramp), (other.omega0, other.duration, other.ramp)
        return mine == theirs and np.array_equal(self.coefficients, other.coefficients)

    def __hash__(self) -> int:
        return hash((self.coefficients.tobytes(), self.omega0, self.duration, self.ramp))

    def to_json(self) -> str:
        """The exact trajectory as JSON text; every float reads back to the same bits."""
        names = ("coefficients", "omega0", "duration", "ramp")
        return to_text("fourier", {name: getattr(self, name) for name in names})

    @classmethod
    def from_json(cls, text: str | bytes) -> FourierTrajectory:
        """Inverse of `to_json`. UsageError if the text is anything else."""
        return from_text(text, {"fourier": cls})


def _check_times(omega0: float, duration: float, ramp: float) -> None:
    if not (math.isfinite(omega0) and omega0 > 0.0):
        raise UsageError(f"omega0 must be a positive number of rad/s, not {omega0}")
    if not (math.isfinite(duration) and duration > 0.0):
        raise UsageError(f"the duration must be a positive number of seconds, not {duration}")
    if not (math.isfinite(ramp) and 0.0 <= 2.0 * ramp <= duration):
        raise UsageError(f"two ramps of {ramp} s do not fit into {duration} s")
