"""Inertial parameters that bodies can have and that explain the commands best, near those of the model file.

    minimise over phi   1/2 phi' H phi - g' phi + weight * sum_b D(P_b | P_b0)
    D(P | P0) = tr(P0^-1 P) - log det(P0^-1 P) - 4

H and g are what the logs say, P_b the matrix of body b (`pseudo_inertia`), P_b0 that of the file. The second
term is the divergence of Lee, Wensing and Park 2020: it does not depend on units or frames and is infinite at
the edge of what a body can have, so a convex problem without constraints gives a possible robot. Newton's
method with the exact derivatives, in coordinates in which every P_b0 is the unit matrix.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.errors import NumericalError
from etude.types import Array
from etude_arm.identified.pseudo_inertia import SIZE, basis, coordinates

WEIGHT = 1.0
"""At the file's values D is half the squared length of the coordinates: before any data every one of them has
a deviation of one, a mass, for example, of itself."""
PATH = tuple(10.0**k for k in range(8, -1, -1))
"""Factors on the weight, each from the minimum before."""
MOST_STEPS = 100
TOLERANCE = 1e-10
E = basis()


@dataclass(frozen=True, eq=False)
class Consistent:
    """What was found.

    Attributes:
        phi: (P,) parameters, body after body; those of bodies without mass in the file stay zero.
        covariance: (P, P) of phi given the logs, prior: (P, P) before them.
        told: how many independent combinations the logs tell better than ten times as well as the file does.
    """

    phi: Array
    covariance: Array
    prior: Array
    told: int


def consistent(H: Array, g: Array, nominal: Array, weight: float = WEIGHT) -> Consistent:
    """The minimum above.

    Args:
        H: (P, P) and g: (P,) of the logs, in units of phi.
        nominal: (P,) the file's parameters, ten for each body.
        weight: of the divergence from them.

    Raises:
        NumericalError: no minimum was reached.
    """
    T, start = _whole(nominal)
    Q, b = T.T @ H @ T, T.T @ g
    x = start
    for stiffer in PATH:  # from the file's values to the logs' by way of both, or Newton's way is long
        x = _newton(Q, b, x, stiffer * weight)
    curvature = Q + weight * _barrier(x)[2]
    covariance = T @ np.linalg.inv(curvature) @ T.T
    prior = T @ np.linalg.inv(weight * _barrier(start)[2]) @ T.T
    ratios = np.linalg.eigvalsh(np.linalg.solve(_barrier(start)[2] * weight, Q))
    return Consistent(T @ x, covariance, prior, int(np.sum(ratios > 99.0)))


def _whole(nominal: Array) -> tuple[Array, Array]:
    """T (P, 10 b) of the b bodies that have a mass, and the coordinates (10 b,) of the file's values."""
    heavy = [k for k in range(0, len(nominal), SIZE) if nominal[k] > 0.0]
    T = np.zeros((len(nominal), SIZE * len(heavy)))
    for i, k in enumerate(heavy):
        T[k : k + SIZE, SIZE * i : SIZE * (i + 1)] = coordinates(nominal[k : k + SIZE])
    return T, np.tile(np.einsum("kii->k", E), len(heavy))


def _newton(Q: Array, b: Array, x: Array, weight: float) -> Array:
    for _ in range(MOST_STEPS):
        value, slope, bend = _barrier(x)
        slope = Q @ x - b + weight * slope
        step = np.asarray(np.linalg.solve(Q + weight * bend, -slope), dtype=np.float64)
        decrease = -float(slope @ step)  # twice what a full step gains
        if decrease < TOLERANCE * (1.0 + abs(float(b @ x))):
            return np.asarray(x + step) if np.isfinite(_barrier(x + step)[0]) else x
        x = x + _length(Q, b, x, step, weight, value, decrease) * step
    raise NumericalError(
        "no possible inertias were found that explain the commands",
        next_step="Look at etude inspect: are the commands forces at the joints, with the right signs?",
    )


def _length(Q: Array, b: Array, x: Array, step: Array, weight: float, value: float, decrease: float) -> float:
    """The largest of 1, 1/2, ... that stays possible and gains a tenth of what the slope promises."""
    before = 0.5 * float(x @ Q @ x) - float(b @ x) + weight * value
    length = 1.0
    while length > 1e-12:
        new = x + length * step
        after = 0.5 * float(new @ Q @ new) - float(b @ new) + weight * _barrier(new, only_value=True)[0]
        if after <= before - 0.1 * length * decrease:
            return length
        length *= 0.5
    return 0.0


def _barrier(x: Array, only_value: bool = False) -> tuple[float, Array, Array]:
    """sum_b tr(X) - log det X - 4, its gradient and Hessian in the coordinates; infinite outside."""
    slope, bend = np.zeros(len(x)), np.zeros((len(x), len(x)))
    value = 0.0
    for k in range(0, len(x), SIZE):
        own = slice(k, k + SIZE)
        X = np.einsum("k,kij->ij", x[own], E)
        if np.linalg.eigvalsh(X)[0] <= 0.0:
            return np.inf, slope, bend
        value += float(np.trace(X)) - float(np.linalg.slogdet(X)[1]) - len(X)
        if only_value:
            continue
        inverse = np.linalg.inv(X)
        slope[own] = np.einsum("kii->k", E) - np.einsum("ij,kji->k", inverse, E)
        turned = np.einsum("ij,kjl,lm->kim", inverse, E, inverse)
        bend[own, own] = np.einsum("kij,lji->kl", turned, E)
    return value, slope, bend
