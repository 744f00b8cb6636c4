"""Conversion of a MuJoCo model to the plain arrays of `kinematics` and `transmission`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError
from etude_arm.physics.kinematics import KinematicTree
from etude_arm.physics.transmission import Drive, joint_drives

Array = NDArray[np.float64]

_HINGE, _SLIDE = 3, 2  # mjtJoint
_ON_JOINT, _ON_TENDON = (0, 1), 3  # mjtTrn: joint, joint in parent; tendon
_WRAP_JOINT, _WRAP_SITE = 1, 3  # mjtWrap
_NO_GRAVITY = 1 << 7  # mjtDisableBit.mjDSBL_GRAVITY


def _rotation(quaternion: Array) -> Array:
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _inertial_parameters(model: Any, body: int) -> Array:
    """[m, m c, I about the body's origin] of one body, in its frame (parallel-axis theorem)."""
    mass, centre = float(model.body_mass[body]), np.asarray(model.body_ipos[body])
    turn = _rotation(model.body_iquat[body])
    about_centre = turn @ np.diag(model.body_inertia[body]) @ turn.T
    inertia = about_centre + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    rows, columns = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)
    return np.concatenate([[mass], mass * centre, inertia[rows, columns]])


def _joint_ids(model: Any, names: tuple[str, ...]) -> list[int]:
    by_name = {model.joint(j).name: j for j in range(model.njnt)}
    missing = [name for name in names if name not in by_name]
    if missing:
        raise UsageError(
            f"The model file has no joint named {', '.join(missing)}",
            where=f"its joints: {', '.join(by_name) or 'none'}",
            next_step="Use the joint names of the model file for the axes in the robot file.",
        )
    wrong = [name for name in names if int(model.jnt_type[by_name[name]]) not in (_HINGE, _SLIDE)]
    if wrong:
        raise UsageError(
            f"The axes {', '.join(wrong)} are neither hinge nor sliding joints in the model file",
            next_step="Only one-degree-of-freedom joints can be axes of a robot.",
        )
    return [by_name[name] for name in names]


def tree_from_mujoco(model: Any, names: tuple[str, ...]) -> KinematicTree:
    """The kinematic tree of a `mujoco.MjModel` whose axes are the joints `names`; others are locked at qpos0.

    Raises:
        UsageError: a name is missing, or belongs to a ball or free joint.
    """
    joints = _joint_ids(model, names)
    kinds = np.asarray(model.jnt_type)[joints]
    order = np.asarray(model.jnt_qposadr)[joints]
    return KinematicTree(
        parent=np.asarray(model.body_parentid, dtype=np.int64),
        position=np.array(model.body_pos, dtype=float),
        rotation=np.stack([_rotation(quat) for quat in model.body_quat]),
        joint_body=np.asarray(model.jnt_bodyid, dtype=np.int64)[joints],
        joint_axis=np.array(model.jnt_axis, dtype=float)[joints],
        joint_anchor=np.array(model.jnt_pos, dtype=float)[joints],
        joint_slides=kinds == _SLIDE,
        joint_zero=np.array(model.qpos0, dtype=float)[order],
        gravity=np.zeros(3)
        if model.opt.disableflags & _NO_GRAVITY
        else np.array(model.opt.gravity, dtype=float),
        nominal=np.stack([_inertial_parameters(model, body) for body in range(model.nbody)]),
    )


def _tendon_drive(model: Any, tendon: int, gear: float, joints: list[int]) -> Drive | None:
    first, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
    wraps = range(first, first + count)
    kinds = {int(model.wrap_type[w]) for w in wraps}
    objects = [int(model.wrap_objid[w]) for w in wraps]
    none = np.zeros(0, dtype=np.int64)
    if kinds == {_WRAP_JOINT}:
        coefficients = np.zeros(len(joints))
        for joint, w in zip(objects, wraps, strict=True):
            if joint in joints:
                coefficients[joints.index(joint)] += model.wrap_prm[w]
        return Drive(gear, coefficients, none, np.zeros((0, 3)))
    if kinds == {_WRAP_SITE}:
        bodies = np.asarray(model.site_bodyid, dtype=np.int64)[objects]
        return Drive(gear, np.zeros(len(joints)), bodies, np.array(model.site_pos, dtype=float)[objects])
    return None


def _drive(model: Any, actuator: int, joints: list[int]) -> Drive | None:
    kind, target = int(model.actuator_trntype[actuator]), int(model.actuator_trnid[actuator, 0])
    gear = float(model.actuator_gear[actuator, 0])
    if kind in _ON_JOINT and target in joints:
        # commands of a joint's own actuator are forces at the joint, as limits, logs and drivers have them
        return joint_drives(len(joints))[joints.index(target)]
    if kind == _ON_TENDON:
        return _tendon_drive(model, target, gear, joints)
    return None


def drives_from_mujoco(model: Any, names: tuple[str, ...]) -> tuple[Drive, ...]:
    """One drive for each axis: the model's actuator that moves it most, or the joint itself if none does.

    Actuators on joints, on fixed tendons and on spatial tendons through sites are understood (pulleys and
    wrapping
    surfaces are not: their axes count as driven at the joint).
    """
    joints = _joint_ids(model, names)
    drives: list[Drive | None] = [None] * len(names)
    for actuator in range(model.nu):
        drive = _drive(model, actuator, joints)
        if drive is None or drive.gear == 0.0:
            continue
        axis = _main_axis(model, drive, joints)
        if axis is not None and drives[axis] is None:
            drives[axis] = drive
    direct = joint_drives(len(names))
    return tuple(drive or plain for drive, plain in zip(drives, direct, strict=True))


def _main_axis(model: Any, drive: Drive, joints: list[int]) -> int | None:
    """The axis a drive moves: the largest constant moment, or the last axis between a tendon's two ends."""
    if np.any(drive.coefficients):
        return int(np.argmax(np.abs(drive.coefficients)))
    ends = [set(_ancestors(model, int(body))) for body in (drive.bodies[0], drive.bodies[-1])]
    between = ends[0] ^ ends[1]
    crossed = [axis for axis, joint in enumerate(joints) if int(model.jnt_bodyid[joint]) in between]
    return max(crossed) if crossed else None


def _ancestors(model: Any, body: int) -> list[int]:
    chain = []
    while body > 0:
        chain.append(body)
        body = int(model.body_parentid[body])
    return chain
