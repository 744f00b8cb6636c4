"""Solid parts of a robot of joints for pictures in space: the shapes of its distance checks.

Pictures show what was proved: a certificate does not cover the meshes behind the hulls.
"""

from __future__ import annotations

import numpy as np

from etude.types import Array, Index, Solid
from etude_arm.clearance.hull_reduction import fewer
from etude_arm.clearance.robot_clearance import skeleton_of_robot
from etude_arm.clearance.skeleton import Shape, Skeleton, points_of
from etude_arm.loading.hulls import hull
from etude_arm.loading.load import of_file
from etude_arm.spec import ArmSpec

MOST_POINTS, CLOSE = 128, 5e-4
"""Corners of a drawn hull at most, and m by which fewer are enough."""
ROUND = 8
"""Circles of a drawn ball, with twice as many points each."""
_cached_solids: dict[str, tuple[Solid, ...]] = {}
_skeletons: dict[str, Skeleton] = {}


def solids(spec: ArmSpec) -> tuple[Solid, ...]:
    """The rigid parts, in the frames of their bodies; empty without shapes."""
    if spec.model_file is None:
        return ()
    return of_file(_cached_solids, spec, lambda: _compiled_solids(_skeleton(spec)))


def placed(spec: ArmSpec, q: Array) -> Array:
    """Frames (T, B, 3, 4) m of those parts in the world at poses q (T, k)."""
    import mujoco

    skeleton = _skeleton(spec)
    model, data = skeleton.model, mujoco.MjData(skeleton.model)
    bodies = _bodies(skeleton)[[skeleton.parts.index(one.name) for one in solids(spec)]]
    frames = np.empty((len(q), len(bodies), 3, 4))
    for row, pose in zip(frames, q, strict=True):
        data.qpos[skeleton.addresses] = pose
        mujoco.mj_kinematics(model, data)
        row[:, :, :3] = data.xmat[bodies].reshape(-1, 3, 3)
        row[:, :, 3] = data.xpos[bodies]
    return frames


def _skeleton(spec: ArmSpec) -> Skeleton:
    return of_file(_skeletons, spec, lambda: skeleton_of_robot(spec))


def _bodies(skeleton: Skeleton) -> Index:
    """Body in the model (parts,) whose frame each part has."""
    return np.unique(np.asarray(skeleton.model.body_weldid, dtype=np.int64))


def _compiled_solids(skeleton: Skeleton) -> tuple[Solid, ...]:
    shapes = [shape for shape in skeleton.shapes if not shape.box] or _visual_shapes(skeleton)
    solid_parts = []
    for part, name in enumerate(skeleton.parts):
        meshes = [_in_part(skeleton, shape) for shape in shapes if shape.part == part]
        if meshes:
            first = np.cumsum([0, *(len(points) for points, _ in meshes[:-1])])
            faces = [faces + start for (_, faces), start in zip(meshes, first, strict=True)]
            solid_parts.append(Solid(name, np.concatenate([p for p, _ in meshes]), np.concatenate(faces)))
    return tuple(solid_parts)


def _visual_shapes(skeleton: Skeleton) -> list[Shape]:
    """Shapes of a model without collisions, for drawing alone."""
    model, bodies = skeleton.model, _bodies(skeleton)
    shapes = []
    for geom in range(model.ngeom):
        points, radius = points_of(model, geom)
        if len(points):
            part = int(np.searchsorted(bodies, model.body_weldid[model.geom_bodyid[geom]]))
            shapes.append(Shape(f"#{geom}", geom, part, points, radius))
    return shapes


def _in_part(skeleton: Skeleton, shape: Shape) -> tuple[Array, Index]:
    """Points (V, 3) m in the frame of the part's body and triangles of one shape."""
    import mujoco

    model, data = skeleton.model, mujoco.MjData(skeleton.model)
    mujoco.mj_kinematics(model, data)
    body = int(_bodies(skeleton)[shape.part])
    turn, place = data.xmat[body].reshape(3, 3), data.xpos[body]
    points, faces = _mesh(model.geom_size[shape.geom], shape)
    world = points @ data.geom_xmat[shape.geom].reshape(3, 3).T + data.geom_xpos[shape.geom]
    return (world - place) @ turn, faces


def _mesh(size: Array, shape: Shape) -> tuple[Array, Index]:
    """Points (V, 3) m in the geom's frame, and triangles, of all within its radius of its points."""
    # a reduced hull is drawn without its thickness
    radius = shape.radius - shape.thickness
    points = _ball() * size if shape.smooth else shape.points
    if radius > 0.0:
        points = (points[:, None] + radius * _ball()).reshape(-1, 3)
    elif len(points) > MOST_POINTS:
        points = fewer(points, MOST_POINTS, CLOSE).points
    return hull(points)


def _ball() -> Array:
    """Directions (n, 3) all around."""
    up, turn = np.meshgrid(np.linspace(0.0, np.pi, ROUND + 1), np.arange(2 * ROUND) * np.pi / ROUND)
    directions = np.stack([np.sin(up) * np.cos(turn), np.sin(up) * np.sin(turn), np.cos(up)], axis=-1)
    return np.unique(directions.reshape(-1, 3).round(12), axis=0)
