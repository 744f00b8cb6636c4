"""Pseudo-inertia: the ten inertial parameters of a body as a symmetric 4 x 4 matrix, positive definite if
possible.

P = [[S, h], [h', m]] with h = m c and S = tr(I) / 2 - I, I about the body's origin: the second moments of its
mass. A mass distribution with these parameters exists if and only if P is positive definite (Wensing, Kim and
Slotine 2017).
"""

from __future__ import annotations

import numpy as np

from etude.types import Array
from etude_arm.loading.inertia import ENTRIES

SIZE = 10  # parameters of a body
FLATTEST = 1e-3
"""Least second moment as a part of the mean: a flat plate needs some thickness, or its parameters could not
change.
"""
PAIRS = tuple((i, j) for _, i, j in ENTRIES)
"""Places of [xx yy zz xy xz yz]."""


def inertia_of(phi: Array) -> Array:
    """I (3, 3) about the body's origin."""
    inertia = np.zeros((3, 3))
    for value, (i, j) in zip(phi[4:], PAIRS, strict=True):
        inertia[i, j] = inertia[j, i] = value
    return inertia


def matrix_of(phi: Array) -> Array:
    """P (4, 4) of [m, m c, I about the origin: xx yy zz xy xz yz] (10,)."""
    inertia = inertia_of(phi)
    P = np.zeros((4, 4))
    P[:3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    P[:3, 3] = P[3, :3] = phi[1:4]
    P[3, 3] = phi[0]
    return P


def parameters_of(P: Array) -> Array:
    """The inverse of `matrix_of`: (10,)."""
    moments = P[:3, :3]
    inertia = np.trace(moments) * np.eye(3) - moments
    return np.concatenate([[P[3, 3]], P[:3, 3], [inertia[i, j] for i, j in PAIRS]])


def is_possible(phi: Array) -> bool:
    """Whether some body has these parameters."""
    return bool(np.linalg.eigvalsh(matrix_of(phi))[0] > 0.0)


def root_of(phi: Array) -> Array:
    """L (4, 4) with P = L L'; the parameters may be at the limit of physical consistency.

    Principal second moments about the centre of mass are raised to `FLATTEST` of their mean.
    """
    mass, centre = phi[0], phi[1:4] / phi[0]
    about_centre = matrix_of(phi)[:3, :3] - mass * np.outer(centre, centre)
    moments, axes = np.linalg.eigh(about_centre)
    least = FLATTEST * max(float(np.mean(np.maximum(moments, 0.0))), np.finfo(float).tiny)
    L = np.zeros((4, 4))
    L[:3, :3] = axes * np.sqrt(np.maximum(moments, least))
    L[:, 3] = np.sqrt(mass) * np.append(centre, 1.0)
    return L


def basis() -> Array:
    """(10, 4, 4) symmetric matrices, orthonormal: coordinates x of X = sum x_k E_k."""
    matrices = []
    for i in range(4):
        for j in range(i, 4):
            E = np.zeros((4, 4))
            E[i, j] = E[j, i] = 1.0 if i == j else np.sqrt(0.5)
            matrices.append(E)
    return np.array(matrices)


def coordinates(phi: Array) -> Array:
    """T (10, 10): parameters T x of P = L X L', X the matrix with coordinates x and L the root at `phi`."""
    L = root_of(phi)
    return np.column_stack([parameters_of(L @ E @ L.T) for E in basis()])
