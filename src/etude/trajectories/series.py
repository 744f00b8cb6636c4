"""Rows of the Fourier series of thesis (3.5): what makes motions, proofs and searches linear."""

from __future__ import annotations

from itertools import product

import numpy as np

from etude.errors import UsageError
from etude.trajectories.extremes import OVERSAMPLING, grid
from etude.trajectories.ramp import PEAK_BEND, PEAK_PRODUCT, PEAK_RATE, phase
from etude.types import Array

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
    and +- c p'; each is a series again, so the bound holds for it. Whatever convex set holds the first two
    holds the others: in each direction, where p' is largest p'' vanishes. Jerk has s^3, 3 s s' and s''.

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
    if harmonics < 2:
        raise UsageError(
            f"rest by equalities needs at least 2 harmonics, not {harmonics}",
            next_step="Use rest = 'ramp' instead.",
        )
    out = np.zeros((2 * harmonics + 1, 2 * harmonics - 1))
    out[0, 0] = 1.0
    out[1:, 1:] = np.linalg.svd(rest_constraints(harmonics)[:, 1:])[2][2:].T
    return out
