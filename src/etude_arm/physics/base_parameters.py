"""Base parameters: the combinations of inertial parameters that motion reveals, found numerically.

Gautier 1991 uses a rank-revealing QR of the regressor at random states. Here it is the singular value
decomposition of the regressor, whitened by a physical prior, so that every kept direction has the same prior,
N(0, 1).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from etude_arm.physics.kinematics import KinematicTree
from etude_arm.spec import ArmSpec

Array = NDArray[np.float64]

RANK_TOLERANCE = 1e-9
"""Relative to the largest singular value; rounding leaves unidentifiable ones near 1e-16."""

MASSLESS = 0.1
"""Part of the mean mass: prior mass of a massless body that carries others, a frame between two axes."""


def spread_states(spec: ArmSpec, count: int) -> tuple[Array, Array, Array]:
    """q, qd, qdd (count, dof) that fill the robot's limits evenly: a Kronecker sequence, the same at every
    call.
    """
    primes = _primes(3 * spec.dof)
    unit = np.mod(np.outer(np.arange(1, count + 1), np.sqrt(primes)), 1.0)
    a, b, c = np.split(unit, 3, axis=1)
    q = spec.lower + a * (spec.upper - spec.lower)
    return q, (2 * b - 1) * spec.velocity, (2 * c - 1) * spec.acceleration


def _primes(count: int) -> Array:
    primes: list[int] = []
    number = 2
    while len(primes) < count:
        if all(number % p for p in primes):
            primes.append(number)
        number += 1
    return np.array(primes, dtype=float)


def parameter_scale(tree: KinematicTree) -> Array:
    """(10 (B - 1),) prior scale of each inertial parameter about its nominal value, in its own unit.

    The scale is the body's mass, times its reach for first moments and its squared reach for inertias. A
    massless body (a URDF link without an inertial element) gets the mean mass, or a part of it between two
    axes.
    """
    mass = tree.nominal[1:, 0]
    typical = float(np.mean(mass[mass > 0])) if np.any(mass > 0) else 1.0
    # below a thousandth of the mean a mass is a placeholder, such as that of a frame
    frame = MASSLESS ** np.isin(np.arange(1, tree.bodies), tree.parent)
    mass = np.where(mass > 1e-3 * typical, mass, frame * typical)
    reach = np.array([_reach(tree, body) for body in range(1, tree.bodies)])
    powers = np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2])
    return np.asarray(mass[:, None] * reach[:, None] ** powers).reshape(-1)


def _reach(tree: KinematicTree, body: int) -> float:
    """Extent of a body, m: the largest of the distances to its centre of mass and its children, and its
    radius of gyration.
    """
    mass = tree.nominal[body, 0]
    gyration = np.sqrt(np.sum(tree.nominal[body, 4:7]) / mass) if mass > 0 else 0.0
    children = [
        np.linalg.norm(tree.position[child]) for child in range(tree.bodies) if tree.parent[child] == body
    ]
    # 1 cm: with a reach of 0, first moments and inertias would be fixed
    return float(max([gyration, *children, 1e-2]))


def base_directions(rows: Array, scale: Array) -> Array:
    """Identifiable directions D (P, r) in parameter space by the regressor `rows` (N, P): phi = phi_0 + D z
    with z ~ N(0, I).

    The columns of D are orthonormal in the metric of `scale` (P,); all other directions change no torque.
    """
    _, singular, right = np.linalg.svd(rows * scale, full_matrices=False)
    rank = int(np.sum(singular > RANK_TOLERANCE * max(float(singular[0]), np.finfo(float).tiny)))
    return np.asarray(scale[:, None] * right[:rank].T)
