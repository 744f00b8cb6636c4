"""Forces at the joints for given inertial parameters: the backward half of recursive Newton-Euler.

The regressor gives the same torques with a column for each parameter; with known parameters this is several
times cheaper.
"""

from __future__ import annotations

import numpy as np

from etude._runtime.operators import cross
from etude.types import Array
from etude_arm.physics.kinematics import BodyMotion, KinematicTree, body_motion
from etude_arm.physics.transmission import Geometry, drive_motion

_PLACES = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])
"""Of xx yy zz xy xz yz in the inertia."""


def nominal_commands(
    geometry: Geometry, q: Array, qd: Array, qdd: Array, friction: Array | float = 0.0
) -> Array:
    """Commands (n, J) by the model file's masses at q, qd, qdd (n, J), in N m or N of the drives.

    friction: (n, J) of the joints, N m or N.
    """
    motion = body_motion(geometry.tree, q, qd, qdd)
    drive = drive_motion(geometry.tree, geometry.drives, motion, qd, qdd)
    return drive.to_drive(joint_forces(geometry.tree, motion) + friction)


def joint_forces(tree: KinematicTree, motion: BodyMotion) -> Array:
    """(n, J) torques of hinges and forces of slides along a motion of the tree's bodies."""
    forces, moments = _wrenches(tree, motion)
    generalized = np.zeros((motion.position.shape[1], tree.joints))
    for body in range(tree.bodies - 1, 0, -1):  # parents come first
        for j in np.flatnonzero(tree.joint_body == body):
            along = motion.axis[j]
            if tree.joint_slides[j]:
                generalized[:, j] = (along * forces[body]).sum(axis=1)
                continue
            lever = cross(motion.position[body] - motion.anchor[j], forces[body])
            generalized[:, j] = (along * (moments[body] + lever)).sum(axis=1)
        parent = int(tree.parent[body])
        arm = motion.position[body] - motion.position[parent]
        moments[parent] += moments[body] + cross(arm, forces[body])
        forces[parent] += forces[body]
    return generalized


def _wrenches(tree: KinematicTree, motion: BodyMotion) -> tuple[Array, Array]:
    """Force and moment about its origin (B, n, 3) that each body needs, in the world's frame."""
    turn, omega, alpha = motion.rotation, motion.omega, motion.alpha
    mass, lever = tree.nominal[:, 0], np.einsum("bnij,bj->bni", turn, tree.nominal[:, 1:4])
    inertia = tree.nominal[:, 4:][:, _PLACES]
    acceleration = motion.acceleration - tree.gravity
    swing = cross(alpha, lever) + cross(omega, cross(omega, lever))
    spin = _turned(turn, inertia, alpha) + cross(omega, _turned(turn, inertia, omega))
    return mass[:, None, None] * acceleration + swing, spin + cross(lever, acceleration)


def _turned(turn: Array, inertia: Array, vector: Array) -> Array:
    """(B, n, 3) R I R' v."""
    local = np.einsum("bnji,bnj->bni", turn, vector)
    return np.asarray(np.einsum("bnij,bnj->bni", turn, local @ np.swapaxes(inertia, 1, 2)))
