"""Check of written files against the logs: MuJoCo's inverse dynamics with them, and the model's physics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from etude.types import Array, Index, Samples
from etude_arm.identified.consistent_parameters import Identified
from etude_arm.identified.model_file_writer import with_drives
from etude_arm.identified.parameter_fit import OFFSET_TERM
from etude_arm.physics.kinematics import body_motion
from etude_arm.physics.mean import RigidBodyMean
from etude_arm.physics.transmission import drive_motion
from etude_arm.spec import PATH, PLAN, ArmSpec

if TYPE_CHECKING:
    import mujoco

STIFFNESS, LEVELS = 5, slice(3, 6)
"""Indices of LuGre's terms of a dcmotor in MuJoCo: in dynprm, and levels and speed in biasprm."""


@dataclass(frozen=True, eq=False)
class Replayed:
    """Root mean square errors of commands, (J,), command units, over samples in which a joint moves away from
    reversals. The identified offset is added, since no model file can state one.

    Attributes:
        file: of MuJoCo's inverse dynamics with the written file.
        drives: the same with the file that has cogging and Stribeck dips.
        physics: of the identified physics that the model uses.
    """

    file: Array
    drives: Array
    physics: Array


def replayed(
    files: Mapping[str, bytes], samples: Samples, spec: ArmSpec, fit: Identified, mean: RigidBodyMean
) -> Replayed:
    """Args:
    files: as of `mjcf`. fit: the parameters in them.
    """
    import mujoco

    plain, *_ = files
    assets = {path.rsplit("/", 1)[-1]: data for path, data in files.items()}
    motion = [samples.log[name] for name in (PLAN if mean.desired else PATH)]
    tree, drives = fit.links.tree, fit.links.drives
    moved = drive_motion(tree, drives, body_motion(tree, *motion), *motion[1:])

    def error(predicted: Array) -> Array:
        return np.asarray(np.sqrt(np.mean((samples.command - predicted) ** 2, axis=0, where=fit.used)))

    def played(name: str) -> Array:
        model = mujoco.MjModel.from_xml_string(files[name].decode(), assets)
        return error(moved.to_drive(inverse(model, spec, *motion)) + fit.drive_terms[:, OFFSET_TERM])

    file = played(plain)
    return Replayed(
        file,
        played(with_drives(plain)) if with_drives(plain) in files else file,
        error(mean.predict(samples.log)),
    )


def inverse(model: mujoco.MjModel, spec: ArmSpec, q: Array, qd: Array, qdd: Array) -> Array:
    """(n, J) forces at the joints, with friction and armature, without contacts and stops, minus forces of
    actuators without control.
    """
    import mujoco

    flags = mujoco.mjtDisableBit
    model.opt.disableflags |= int(flags.mjDSBL_CONTACT) | int(flags.mjDSBL_LIMIT) | int(flags.mjDSBL_EQUALITY)
    data = mujoco.MjData(model)
    places = [model.joint(name) for name in spec.names]
    at, dofs = (np.array([int(getattr(p, name)[0]) for p in places]) for name in ("qposadr", "dofadr"))
    for name, place in spec.held.items():
        joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
        if joint >= 0:  # in a URDF a held link is merged into its parent
            data.qpos[model.jnt_qposadr[joint]] = place
    free = np.flatnonzero(
        (model.actuator_ctrlnum == 0) & (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT)
    )
    driven = model.jnt_dofadr[model.actuator_trnid[free, 0]]
    forces = np.zeros_like(q)
    for i in range(len(q)):
        data.qpos[at], data.qvel[dofs], data.qacc[dofs] = q[i], qd[i], qdd[i]
        mujoco.mj_inverse(model, data)
        _settle(model, data, free, driven)
        mujoco.mj_fwdActuation(model, data)
        force = data.qfrc_inverse.copy()
        np.subtract.at(force, driven, model.actuator_gear[free, 0] * data.actuator_force[free])
        forces[i] = force[dofs]
    return forces


def _settle(model: mujoco.MjModel, data: mujoco.MjData, free: Index, driven: Index) -> None:
    """LuGre's bristle deflection at steady speed, since a single instant does not determine it."""
    for k, dof in zip(free, driven, strict=True):
        stiffness = float(model.actuator_dynprm[k, STIFFNESS])
        if stiffness > 0.0:
            least, most, slow = model.actuator_biasprm[k, LEVELS]
            speed = float(model.actuator_gear[k, 0] * data.qvel[dof])
            level = least + (most - least) * np.exp(-((speed / slow) ** 2))
            data.act[model.actuator_actadr[k]] = np.sign(speed) * level / stiffness
