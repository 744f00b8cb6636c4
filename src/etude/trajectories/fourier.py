"""Fourier series and trajectories, thesis (3.5): every derivative is linear in the coefficients."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from etude.errors import UsageError
from etude.protocols import Trajectory
from etude.trajectories.config import require_rest
from etude.trajectories.extremes import OVERSAMPLING, grid
from etude.types import Array, Motion

if TYPE_CHECKING:
    from etude._runtime.pictures import Picture

RAMP_ORDERS = 4
"""Orders (position, ..., jerk) that a phase ramp has: its own third derivative jumps."""


def series(angle: Array, harmonics: int, omega0: float, orders: int = 4) -> Array:
    """Rows of the series and of its time derivatives at phase angles omega0 * theta.

    Args:
        angle: (T,) rad.
        harmonics: N.
        omega0: base frequency, rad/s.
        orders: O, at least 1.

    Returns:
        (O, T, 2N+1), to be multiplied with coefficients [q0, a_1..a_N, b_1..b_N].
    """
    i = np.arange(1, harmonics + 1)
    sine, cosine = np.sin(np.outer(angle, i)), np.cos(np.outer(angle, i))
    w = omega0 * i
    out = np.zeros((max(orders, 3), len(angle), 2 * harmonics + 1))
    out[0, :, 0] = 1.0
    # (3.5): a_i/(w0 i) sin - b_i/(w0 i) cos, product form
    out[0, :, 1:] = np.hstack([sine / w, -cosine / w])
    out[1, :, 1:] = np.hstack([cosine, sine])
    out[2, :, 1:] = np.hstack([-w * sine, w * cosine])
    squares = np.concatenate([w * w, w * w])
    for order in range(3, orders):
        out[order, :, 1:] = -squares * out[order - 2, :, 1:]  # two more derivatives of a harmonic
    return out[:orders]


PEAK_RATE = 15.0 / 8.0
"""max S'(s) for S(s) = s^3 (10 - 15 s + 6 s^2)."""
PEAK_BEND = 10.0 / math.sqrt(3.0)
"""max |S''(s)|."""
PEAK_PRODUCT = 1.195
"""No less than max S(s) S'(s), 1.19482."""


def phase(t: Array, duration: float, ramp: float) -> tuple[Array, Array, Array, Array]:
    """Series time theta(t) and its first three derivatives; theta' = S(t/ramp), mirrored at the end.

    Args:
        t: (T,) s; times outside [0, duration] are held at the nearer end with zero rates.
        duration: s.
        ramp: length of each ramp in s, 0 <= 2 ramp <= duration; theta advances ramp/2 in each.

    Returns:
        theta in s, theta', theta'' in 1/s, theta''' in 1/s^2, each (T,).
    """
    t = np.asarray(t, dtype=float)
    inside = (t >= 0.0) & (t <= duration)
    held = np.clip(t, 0.0, duration)
    zero = np.zeros_like(held)
    if ramp == 0.0:
        return held, inside.astype(float), zero, zero
    from_end = held > 0.5 * duration
    run = np.where(from_end, duration - held, held)
    s = np.minimum(run / ramp, 1.0)
    # time runs up by the quintic 10 s³ - 15 s⁴ + 6 s⁵: its integral here, itself and its derivatives below
    area = np.where(s < 1.0, ramp * s**4 * (2.5 - 3.0 * s + s * s), run - 0.5 * ramp)
    theta = np.where(from_end, duration - ramp - area, area)
    rate = np.where(inside, s**3 * (10.0 - 15.0 * s + 6.0 * s * s), 0.0)
    side = np.where(from_end, -1.0, 1.0)
    second = side * 30.0 * (s * (1.0 - s)) ** 2 / ramp
    third = np.where(inside, 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / ramp**2, 0.0)
    return theta, rate, second, third


def basis(
    t: Array, harmonics: int, omega0: float, duration: float, ramp: float = 0.0, orders: int = 3
) -> Array:
    """Rows (O, T, 2N+1) that give position and derivatives at times t (T,) s from the coefficients.

    At rest outside [0, duration].

    Raises:
        UsageError: fewer orders than one, or more than a phase ramp has.
    """
    if orders < 1 or (ramp > 0.0 and orders > RAMP_ORDERS):
        raise UsageError(
            f"a series with a phase ramp of {ramp:g} s has the orders 1 to {RAMP_ORDERS}, not {orders}",
            next_step="Use rest = 'nullspace' or 'none' where snap is needed.",
        )
    theta, rate, second, third = phase(t, duration, ramp)
    rows = series(omega0 * theta, harmonics, omega0, orders)
    r1, r2, r3 = rate[:, None], second[:, None], third[:, None]
    if ramp == 0.0:
        rows[1:] *= r1
        return rows
    return np.stack([_chained(rows, order, r1, r2, r3) for order in range(orders)])


def _chained(rows: Array, order: int, r1: Array, r2: Array, r3: Array) -> Array:
    """Chain rule: the derivative in t from derivatives in theta, up to jerk."""
    if order == 0:
        return np.asarray(rows[0])
    if order == 1:
        return np.asarray(rows[1] * r1)
    if order == 2:
        return np.asarray(rows[2] * r1**2 + rows[1] * r2)
    return np.asarray(rows[3] * r1**3 + 3.0 * rows[2] * r1 * r2 + rows[1] * r3)


def instants(
    order: int,
    degree: int,
    harmonics: int,
    omega0: float,
    ramp: float = 0.0,
    oversampling: int = OVERSAMPLING,
) -> tuple[Array, float]:
    """Rows (M, 2N+1) whose values bound that derivative at all times, and kappa.

    Without a ramp these are the samples of the Riesz bound: max_t |.| <= max |values| / kappa; on the grid of
    degree 2 the same holds of squared norms and of any quadratic form.

    On a ramp, p the series and s its phase rate, velocity is p' s with 0 <= s <= 1, which is between
    p' and 0. Acceleration is p'' s^2 + p' s', with |s'| <= c, so it lies between the instants p'' +- c p'
    and +- c p'; each of these is a series again, so the bound applies to it. Every convex set that contains
    the first two also contains the others, since p'' vanishes where p' is largest in a direction. Jerk has
    s^3, 3 s s' and s''.

    Raises:
        UsageError: snap and above on a ramp.
    """
    angles, kappa = grid(degree * harmonics, oversampling)
    rows = series(angles, harmonics, omega0, order + 1)
    if ramp == 0.0 or order < 2:
        return rows[order], kappa
    if order >= RAMP_ORDERS:
        raise UsageError(f"nothing bounds derivative {order} of a series with a phase ramp of {ramp:g} s")
    sides = [PEAK_RATE / ramp] if order == 2 else [3.0 * PEAK_PRODUCT / ramp, PEAK_BEND / ramp**2]
    tops = [1.0] if order == 2 else [1.0, 0.0]
    lower = [side * rows[order - 1 - k] for k, side in enumerate(sides)]
    corners = [
        top * rows[order] + sum(sign * part for sign, part in zip(signs, lower, strict=True))
        for top in tops
        for signs in product((1.0, -1.0), repeat=len(sides))
    ]
    return np.concatenate(corners), kappa


def rest_constraints(harmonics: int) -> Array:
    """(2, 2N+1) rows C with C x = 0 for zero velocity and zero acceleration at t = 0 (scaled by 1/omega0)."""
    i = np.arange(1, harmonics + 1, dtype=float)
    rows = np.zeros((2, 2 * harmonics + 1))
    rows[0, 1 : harmonics + 1] = 1.0  # qd(0) = sum a_i
    rows[1, harmonics + 1 :] = i  # qdd(0) / w0 = sum i b_i
    return rows


def rest_nullspace(harmonics: int) -> Array:
    """Orthonormal basis Z (2N+1, 2N-1) of the coefficients that start at rest: sum a_i = 0, sum i b_i = 0.

    Its first column is the constant term alone. The trajectory also ends at rest when its duration is a whole
    number of periods 2 pi/omega0. The equalities do not depend on omega0 in the product form of thesis (3.5).

    Raises:
        UsageError: fewer than two harmonics; only standing still would be left.
    """
    require_rest(harmonics)
    out = np.zeros((2 * harmonics + 1, 2 * harmonics - 1))
    out[0, 0] = 1.0
    out[1:, 1:] = np.linalg.svd(rest_constraints(harmonics)[:, 1:])[2][2:].T
    return out


def to_text(form: str, fields: Mapping[str, Any]) -> str:
    """JSON text of a trajectory; floats are printed so that they read back to the same bits."""
    content = {name: np.asarray(value, dtype=float).tolist() for name, value in fields.items()}
    return json.dumps({"form": form, **content}, indent=1) + "\n"


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
        """Form in its file, which tracking margins depend on."""
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
        """Whether the values of `bound` are samples of the motion; with a phase ramp they only enclose it."""
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
        from etude._runtime.pictures import picture_of

        return picture_of("trajectory", self, path)

    def to_json(self) -> str:
        """The exact trajectory as JSON text; every float reads back to the same bits."""
        names = ("coefficients", "omega0", "duration", "ramp")
        return to_text(self.form, {name: getattr(self, name) for name in names})


def check_times(omega0: float, duration: float, ramp: float) -> None:
    """Raise UsageError unless 0 < omega0, 0 < duration and two ramps fit into it."""
    if not (math.isfinite(omega0) and omega0 > 0.0):
        raise UsageError(f"omega0 must be a positive number of rad/s, not {omega0}")
    if not (math.isfinite(duration) and duration > 0.0):
        raise UsageError(f"the duration must be a positive number of seconds, not {duration}")
    if not (math.isfinite(ramp) and 0.0 <= 2.0 * ramp <= duration):
        raise UsageError(f"two ramps of {ramp} s do not fit into {duration} s")
