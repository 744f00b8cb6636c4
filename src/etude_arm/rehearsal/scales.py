"""How heavy a robot is, joint by joint: inertia and gravity over its poses, from the masses of its file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from etude.types import Array
from etude_arm.rehearsal.body import rows
from etude_arm.spec import ArmSpec

if TYPE_CHECKING:
    import mujoco

POSES = 300
SEED = 0
"""Of the poses: a robot is always the same."""


@dataclass(frozen=True, eq=False)
class Scales:
    """Over random poses within the limits, (J,) each.

    Attributes:
        inertia: (POSES, J) the diagonal of the mass matrix, kg m^2 (kg), without armature.
        felt: the least inertia that a joint can feel with the others free, 1 / (M^-1)_jj, with `armature`.
        gravity: (POSES, J) torque that holds the pose, N m (N).
    """

    inertia: Array
    felt: Array
    gravity: Array

    @property
    def median(self) -> Array:
        return np.asarray(np.median(self.inertia, axis=0))


def scales_of(model: mujoco.MjModel, spec: ArmSpec, armature: Array) -> Scales:
    """Of a model without armature, and of it with `armature` (J,) where it says so."""
    import mujoco

    data, own = mujoco.MjData(model), rows(model, spec)
    poses = np.random.default_rng(SEED).uniform(spec.lower, spec.upper, (POSES, spec.dof))
    inertia, gravity, felt = np.empty((3, POSES, spec.dof))
    M = np.empty((model.nv, model.nv))
    for k, q in enumerate(poses):
        data.qpos[own] = q
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, M)
        full = M[np.ix_(own, own)]
        inertia[k], gravity[k] = np.diag(full), data.qfrc_bias[own] - data.qfrc_passive[own]
        felt[k] = 1.0 / np.diag(np.linalg.inv(full + np.diag(armature)))
    return Scales(inertia, felt.min(axis=0), gravity)


def effort(model: mujoco.MjModel, spec: ArmSpec, motion: tuple[Array, Array, Array]) -> Array:
    """(T, J) torque of bodies and rotors along q, qd, qdd (T, J each), by `mj_inverse`; no friction."""
    import mujoco

    data, own = mujoco.MjData(model), rows(model, spec)
    found = np.empty_like(motion[0])
    for k, (q, qd, qdd) in enumerate(zip(*motion, strict=True)):
        data.qpos[own], data.qvel[own], data.qacc[own] = q, qd, qdd
        mujoco.mj_inverse(model, data)
        found[k] = data.qfrc_inverse[own]
    return found
