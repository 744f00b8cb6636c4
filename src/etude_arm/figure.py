"""Stick figure of a robot of joints, with its surroundings and load as flat faces."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from etude.types import CUBE, CUBE_FACES, FAR, Array, Figure, Thing
from etude_arm.clearance.surroundings import Box, Column, Surroundings, Wall
from etude_arm.loading.attachments import Mounting
from etude_arm.loading.load import load_arm, of_file
from etude_arm.loading.loaded_model import Loaded
from etude_arm.loading.rotations import turn_of
from etude_arm.physics.geometry import read_geometry
from etude_arm.physics.kinematics import KinematicTree, body_motion
from etude_arm.rehearsal.body import tips
from etude_arm.spec import ArmSpec

SIDES = 16
"""Of the prism that a round shape is drawn as."""
ABOVE = 1e-3
"""m by which a base has to stand above the floor for that to be drawn."""

Faces = tuple[tuple[int, ...], ...]


def standing_things(around: Surroundings, mounting: Mounting | None) -> tuple[Thing, ...]:
    """Floor, walls, boxes, room and column, and the line from a mounted base to the floor."""
    base = np.zeros(3) if mounting is None else np.array(mounting.position)
    things = (
        [_plane("floor", Wall("", (0.0, 0.0, around.floor.height), (0, 0, 1)), base)] if around.floor else []
    )
    things += [_plane(wall.name, wall, base) for wall in around.wall]
    things += [_box(box) for box in around.box]
    if around.room is not None:
        low, high = np.array(around.room.lower), np.array(around.room.upper)
        things.append(_still("room", "inside", 0.5 * (low + high) + 0.5 * (high - low) * CUBE, CUBE_FACES))
    if around.column is not None:
        things.append(_column(around.column))
    height = around.floor.height if around.floor else 0.0
    if base[2] > height + ABOVE:
        foot = np.array([base, [base[0], base[1], height]])
        things.append(_still(f"base, {base[2] - height:.3g} m up", "stand", foot, ((0, 1),)))
    return tuple(things)


def carried_things(spec: ArmSpec, loaded: Loaded, q: Array) -> tuple[Thing, ...]:
    """Tool and payload with shapes, along the poses q (T, J)."""
    named = [(name, one) for name, one in (("tool", spec.tool), ("payload", spec.payload)) if one]
    shaped = {name: one for name, one in named if one.shape != "none"}
    if not shaped:
        return ()
    frames = _frames(loaded, q, list(shaped))
    things = []
    for (name, one), (places, turns) in zip(shaped.items(), frames, strict=True):
        points, faces = _solid(one.shape, one.size)
        things.append(Thing(name, "carried", places[:, None] + points @ turns.transpose(0, 2, 1), faces))
    return tuple(things)


def _frames(loaded: Loaded, q: Array, names: list[str]) -> list[tuple[Array, Array]]:
    """Centre (T, 3) m and rotation (T, 3, 3), in the world, of each added shape with these names."""
    import mujoco

    model = loaded.model()
    data, columns = mujoco.MjData(model), loaded.columns(model)
    geoms = [model.geom(f"{loaded.added[name]}#0").id for name in names]
    places, turns = np.zeros((len(geoms), len(q), 3)), np.zeros((len(geoms), len(q), 9))
    for k, pose in enumerate(q):
        data.qpos[columns] = pose
        mujoco.mj_kinematics(model, data)
        places[:, k], turns[:, k] = data.geom_xpos[geoms], data.geom_xmat[geoms]
    return [(place, turn.reshape(-1, 3, 3)) for place, turn in zip(places, turns, strict=True)]


def _still(
    name: str, kind: Literal["solid", "plane", "inside", "stand"], points: Array, faces: Faces
) -> Thing:
    return Thing(name, kind, points[None], faces)


def _box(box: Box) -> Thing:
    points = 0.5 * np.array(box.size) * CUBE @ turn_of(0.0, 0.0, box.turn).T + np.array(box.centre)
    return _still(box.name, "solid", points, CUBE_FACES)


def _plane(name: str, wall: Wall, base: Array) -> Thing:
    """A square of the plane around the point of it that is nearest to the base."""
    normal = np.array(wall.normal) / np.linalg.norm(wall.normal)
    foot = base - normal * float((base - np.array(wall.point)) @ normal)
    return Thing.plane(name, foot.tolist(), normal.tolist())


def _column(column: Column) -> Thing:
    """A column from the floor of the world up; pictures cut its open end."""
    points, faces = _solid("cylinder", (column.radius, 2.0 * FAR))
    return _still("column", "inside", points + np.array([*column.centre, 0.0]), faces[2:])


def _solid(shape: str, size: tuple[float, ...]) -> tuple[Array, Faces]:
    """Points (P, 3) m about its centre, and faces: a box, a cylinder along z, or three rings of a sphere."""
    if shape == "box":
        return 0.5 * np.array(size) * CUBE, CUBE_FACES
    angles = 2.0 * math.pi * np.arange(SIDES) / SIDES
    ring = size[0] * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(SIDES)])
    if shape == "sphere":
        rings = np.concatenate([np.roll(ring, shift, axis=1) for shift in range(3)])
        return rings, tuple(tuple(range(k * SIDES, (k + 1) * SIDES)) for k in range(3))
    up = np.array([0.0, 0.0, 0.5 * size[1]])
    ends = (tuple(range(SIDES)), tuple(range(SIDES, 2 * SIDES)))
    sides = tuple((k, (k + 1) % SIDES, SIDES + (k + 1) % SIDES, SIDES + k) for k in range(SIDES))
    return np.concatenate([ring - up, ring + up]), (*ends, *sides)


@dataclass(frozen=True, eq=False)
class _Sticks:
    """Parts of the figure that do not depend on the pose.

    Attributes:
        loaded: the robot, without shapes. tree: its rigid bodies.
        before: (J,) parent joint of each joint; -1: the base.
        last: joints without a child. reaches: (3,) m to the tip of each, in the frame of its body.
    """

    loaded: Loaded
    tree: KinematicTree
    before: tuple[int, ...]
    last: tuple[int, ...]
    reaches: tuple[Array, ...]


_cached_sticks: dict[str, _Sticks] = {}


def _sticks(spec: ArmSpec) -> _Sticks:
    geometry = read_geometry(spec)
    assert geometry is not None
    tree = geometry.tree
    bodies, carried_by = tree.joint_body.tolist(), tree.parent.tolist()
    before = [_joint_before(j, bodies, carried_by) for j in range(spec.dof)]
    last = sorted(set(range(spec.dof)) - set(before))
    loaded = load_arm(spec, shapes=False)
    return _Sticks(
        loaded, tree, tuple(before), tuple(last), tuple(tips(loaded, [spec.names[j] for j in last]))
    )


def figure(spec: ArmSpec, q: Array) -> Figure:
    """Points: the base, the joints in the robot's order, then the tips of joints without a child.

    Around it are the surroundings in the robot file, and the arm's load. Limits of plug-ins make figures
    hundreds of times in a search, so the model file is read once.

    Args:
        spec: of the robot. q: (T, J) poses, rad (m).

    Raises:
        UsageError: the model file cannot be loaded.
    """
    assert spec.model_file is not None
    if not spec.model_file.is_file():
        return _drawn(_sticks(spec), spec, q)  # raises the error
    return _drawn(of_file(_cached_sticks, spec, lambda: _sticks(spec)), spec, q)


def _drawn(sticks: _Sticks, spec: ArmSpec, q: Array) -> Figure:
    tree, still = sticks.tree, np.zeros_like(q)
    motion = body_motion(tree, q, still, still)
    bodies = tree.joint_body.tolist()
    hands = [
        motion.position[bodies[j]] + motion.rotation[bodies[j]] @ reach
        for j, reach in zip(sticks.last, sticks.reaches, strict=True)
    ]
    base = np.zeros(3) if spec.mounting is None else np.array(spec.mounting.position)
    points = np.stack([np.tile(base, (len(q), 1)), *motion.anchor, *hands], axis=1)
    ends = range(spec.dof + 1, spec.dof + 1 + len(hands))
    pairs = [(sticks.before[j] + 1, j + 1) for j in range(spec.dof)]
    pairs += [(j + 1, end) for j, end in zip(sticks.last, ends, strict=True)]
    things = (*standing_things(spec.around, spec.mounting), *carried_things(spec, sticks.loaded, q))
    return Figure(points, np.array(pairs), tuple(ends), things)


def _joint_before(j: int, bodies: list[int], carried_by: list[int]) -> int:
    """Parent joint of joint j; -1: the base."""
    same = [i for i in range(j) if bodies[i] == bodies[j]]
    if same:
        return same[-1]
    body = carried_by[bodies[j]]
    while body > 0:
        joints = [i for i, other in enumerate(bodies) if other == body]
        if joints:
            return joints[-1]
        body = carried_by[body]
    return -1
