"""What an MJCF says of its robot at one pose: MuJoCo's own kinematics of the file as it is.

MuJoCo defines what an MJCF means: defaults by class, includes, attached models, masses from shapes, orders of
Euler angles. A second reader of all that would err more often than what it is to find. So the second
evaluation is MuJoCo's of the whole file, before anything is written of it: all bodies and joints, held ones
at their positions. The mounting is a product with it, tool and payload are added to its bodies.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from etude.types import Array
from etude_arm.loading.attached import Additions, Attached, Mounting
from etude_arm.loading.choice import Choice
from etude_arm.loading.expected import Expected, Place, chain_matrix, gathered, pose_of_joints
from etude_arm.loading.mjcf_parts import SHAPES, name_of
from etude_arm.loading.names import free_name
from etude_arm.loading.urdf_expected import carried_place, pose_matrix

if TYPE_CHECKING:
    import mujoco

SLIDE = 2  # mjtJoint
NO_GRAVITY = 1 << 7  # mjtDisableBit.mjDSBL_GRAVITY
SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3, "mesh": 0}


def mjcf_expected(model: mujoco.MjModel, choice: Choice, added: Additions) -> Expected:
    """Of the model of a whole MJCF, its chosen joints, and what is added to it."""
    import mujoco

    joints = [model.joint(name).id for name in choice.joints]
    slides = np.array([int(model.jnt_type[j]) == SLIDE for j in joints])
    q, data = pose_of_joints(slides), mujoco.MjData(model)
    for name, value in (*choice.held.items(), *zip(choice.joints, q.tolist(), strict=True)):
        data.qpos[model.jnt_qposadr[model.joint(name).id]] = value
    mujoco.mj_kinematics(model, data)
    mounting = added.mounting or Mounting()
    base = pose_matrix(mounting.position, mounting.rotation)
    pose = [base @ _matrix(*of) for of in zip(data.xpos, data.xmat, strict=True)]
    moved, before = _moved(model, joints)
    parts = []
    for b in np.flatnonzero((np.array(moved) >= 0) & (model.body_mass > 0.0)).tolist():
        own = base @ _matrix(data.xipos[b], data.ximat[b])
        inertia = own[:3, :3] * model.body_inertia[b] @ own[:3, :3].T
        parts.append((moved[b], float(model.body_mass[b]), own[:3, 3], inertia))
    places = _places(model, data, base)
    taken = [name_of(model, b) for b in range(model.nbody)]
    for what, one in added.carried:
        b = taken.index(one.link) if one.link else _tip(model, joints, before)
        own = pose[b] @ pose_matrix(one.centre, (0.0, 0.0, 0.0))
        parts += _weighing(moved[b], one, own)
        places[free_name(what, taken)] = carried_place(one, pose[b])
    mass, centre, inertia = gathered(parts, len(q))
    gravity = np.zeros(3) if model.opt.disableflags & NO_GRAVITY else np.array(model.opt.gravity)
    return Expected(
        q=q,
        joints=choice.joints,
        slides=slides,
        gravity=gravity,
        base=base,
        anchor=data.xanchor[joints] @ base[:3, :3].T + base[:3, 3],
        axis=data.xaxis[joints] @ base[:3, :3].T,
        frame=np.array([pose[int(model.jnt_bodyid[j])] for j in joints]),
        moves=chain_matrix(np.array(before)),
        mass=mass,
        centre=centre,
        inertia=inertia,
        carried={what: one.mass for what, one in added.carried},
        shapes=places,
    )


def _matrix(place: Array, turn: Array) -> Array:
    found = np.eye(4)
    found[:3, 3], found[:3, :3] = place, turn.reshape(3, 3)
    return found


def _moved(model: mujoco.MjModel, joints: list[int]) -> tuple[list[int], list[int]]:
    """Of each body the last chosen joint that moves it, of each such joint the one that carries it; or -1."""
    moved, before = [-1] * model.nbody, [-1] * len(joints)
    for b in range(1, model.nbody):
        last = moved[int(model.body_parentid[b])]
        first = int(model.body_jntadr[b])
        for j in range(first, first + int(model.body_jntnum[b])):
            if j in joints:
                before[joints.index(j)], last = last, joints.index(j)
        moved[b] = last
    return moved, before


def _tip(model: mujoco.MjModel, joints: list[int], before: list[int]) -> int:
    """The body of the chosen joint that carries no other."""
    last = next(j for i, j in enumerate(joints) if i not in before)
    return int(model.jnt_bodyid[last])


def _weighing(joint: int, one: Attached, place: Array) -> list[tuple[int, float, Array, Array]]:
    if joint < 0:
        return []
    inertia = place[:3, :3] @ one.moments() @ place[:3, :3].T
    return [(joint, one.mass, place[:3, 3], inertia)]


def _places(model: mujoco.MjModel, data: mujoco.MjData, base: Array) -> dict[str, tuple[Place, ...]]:
    """Of all shapes; those that collide must be."""
    found: dict[str, tuple[Place, ...]] = {}
    for g in range(model.ngeom):
        kind = SHAPES.get(int(model.geom_type[g]))
        if kind is not None:
            pose = base @ _matrix(data.geom_xpos[g], data.geom_xmat[g])
            size = tuple(model.geom_size[g][: SIZES[kind]].tolist())
            needed = bool(model.geom_contype[g] or model.geom_conaffinity[g])
            name = name_of(model, int(model.geom_bodyid[g]))
            found[name] = (*found.get(name, ()), Place(kind, pose[:3, 3], pose[:3, :3], size, needed))
    return found
