"""The limits in space of a robot as its file describes it, made once for each description."""

from __future__ import annotations

import numpy as np

from etude.errors import UsageError
from etude.types import Array
from etude_arm.loading.load import load_arm
from etude_arm.of_file import of_file
from etude_arm.physics.geometry import read_geometry
from etude_arm.physics.kinematics import BodyMotion, KinematicTree, body_motion
from etude_arm.physics.transmission import Geometry
from etude_arm.rehearsal.body import tips
from etude_arm.space.limit import Points, SpaceLimit
from etude_arm.space.reach import reaches
from etude_arm.space.table import Cartesian
from etude_arm.spec import ArmSpec

TOOL = "tool"
_known: dict[str, SpaceLimit] = {}


def space_of(spec: ArmSpec) -> SpaceLimit | None:
    """The limit; None where the robot file has no [cartesian] with a limit in it.

    Raises:
        UsageError: the robot has no model file; or a speed of links is asked of one without shapes.
    """
    table = spec.cartesian
    if table is None or table == Cartesian(point=table.point):
        return None
    if spec.model_file is None:
        raise UsageError(
            f"robot '{spec.name}' has no model_file, and [cartesian] needs to know where its links are",
            next_step="Add a URDF or MJCF to the robot file, or take [cartesian] out.",
        )
    return of_file(_known, spec, lambda: _made(spec, table))


def _made(spec: ArmSpec, table: Cartesian) -> SpaceLimit:
    geometry = read_geometry(spec)
    assert geometry is not None
    last = geometry.tree.joint_body[spec.dof - 1]
    end = tips(load_arm(spec, shapes=False), [spec.names[-1]])[0] if table.point is None else table.point
    pose = np.clip(np.zeros(spec.dof), spec.lower, spec.upper)
    still = np.zeros((1, spec.dof))
    motion = body_motion(geometry.tree, pose[None], still, still)
    tool = _points(TOOL, int(last), np.array([end], dtype=float), spec, geometry.tree, motion, pose)
    links = _links(spec, geometry, motion, pose) if table.link_speed is not None else ()
    return SpaceLimit(geometry.tree, tool, links, table)


def _links(spec: ArmSpec, geometry: Geometry, motion: BodyMotion, pose: Array) -> tuple[Points, ...]:
    """The corners of a box around the shapes of each moving part, in the frame of the body that moves it."""
    import mujoco

    from etude_arm.clearance.skeleton import skeleton_of

    skeleton = skeleton_of(load_arm(spec).model(), spec.names, spec.lower, spec.upper)
    data = mujoco.MjData(skeleton.model)
    data.qpos[skeleton.addresses] = pose
    mujoco.mj_kinematics(skeleton.model, data)
    found = []
    for part, name in enumerate(skeleton.parts):
        chain, own = skeleton.chain(part), [shape for shape in skeleton.shapes if shape.part == part]
        if not chain or not own:
            continue
        body = int(geometry.tree.joint_body[chain[-1]])
        corners = []
        for shape in own:
            turn, place = data.geom_xmat[shape.geom].reshape(3, 3), data.geom_xpos[shape.geom]
            world = shape.points @ turn.T + place
            local = (world - motion.position[body, 0]) @ motion.rotation[body, 0]
            corners += [local - shape.radius, local + shape.radius]
        low, high = np.concatenate(corners).min(axis=0), np.concatenate(corners).max(axis=0)
        grid = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
        found.append(_points(name, body, grid, spec, geometry.tree, motion, pose))
    if not found:
        raise UsageError(
            f"link_speed needs shapes, and robot '{spec.name}' has none",
            where="cartesian",
            next_step="Limit speed, of the tool's point, instead.",
        )
    return tuple(found)


def _points(
    name: str, body: int, at: Array, spec: ArmSpec, tree: KinematicTree, motion: BodyMotion, pose: Array
) -> Points:
    world = motion.position[body, 0] + at @ motion.rotation[body, 0].T
    chain = _chain(tree, body)
    travel = np.maximum(np.abs(spec.lower - pose), np.abs(spec.upper - pose))
    added = np.where(tree.joint_slides, travel, 0.0)
    joints = motion.anchor[:, 0], motion.axis[:, 0]
    reach = reaches(world, np.zeros(len(world)), chain, joints, tree.joint_slides, added)
    return Points(name, body, at, tuple(chain), reach)


def _chain(tree: KinematicTree, body: int) -> list[int]:
    """The joints that move a body, the innermost first; of several on one body, in their order."""
    found: list[int] = []
    while body > 0:
        found = [j for j in range(tree.joints) if tree.joint_body[j] == body] + found
        body = int(tree.parent[body])
    return found
