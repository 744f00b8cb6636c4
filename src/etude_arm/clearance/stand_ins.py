"""Shapes of many points, as fine CAD has them, and the hulls of few that stand for them.

Whatever is searched and proved is then about something larger than the shape. Where two shapes stand so close
at home that this would take much of their room, they stay as they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from etude.types import Array
from etude_arm.clearance.fewer import Fewer, fewer
from etude_arm.clearance.gaps import Gaps
from etude_arm.clearance.skeleton import Shape, Skeleton

MANY = 1000
"""Points above which a hull of fewer stands for a shape."""
ROOM = 4.0
"""A gap that is narrower at home than so many times what stand-ins would take of it keeps its shapes."""


def stand_ins(gaps: Gaps, home: Array) -> dict[str, Fewer]:
    """By the names of shapes what stands for them, in m in the frame that the model file gives their meshes.

    Args:
        gaps: of the shapes as they are. home: (k,) pose.
    """
    shapes = gaps.skeleton.shapes
    looked_at = {i for gap in gaps.list for i in (gap.one, gap.other) if i >= 0}
    found = {i: fewer(shapes[i].points) for i in sorted(looked_at) if len(shapes[i].points) > MANY}
    if not found:
        return {}
    for gap, distance in zip(gaps.list, gaps.of_poses(home[None])[0], strict=True):
        ends = [found[i].radius for i in (gap.one, gap.other) if i in found]
        if distance < ROOM * sum(ends):
            found = {i: one for i, one in found.items() if i not in (gap.one, gap.other)}
    return {shapes[i].name: _in_file(gaps.skeleton, shapes[i], one) for i, one in found.items()}


def _in_file(skeleton: Skeleton, shape: Shape, found: Fewer) -> Fewer:
    """From the frame of the compiled geom, which MuJoCo lays into the mesh's own axes of inertia."""
    import mujoco

    mesh = int(skeleton.model.geom_dataid[shape.geom])
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, skeleton.model.mesh_quat[mesh])
    return replace(found, points=found.points @ turn.reshape(3, 3).T + skeleton.model.mesh_pos[mesh])


def put(spec: Any, found: Mapping[str, Fewer]) -> None:
    """Gives geoms of a `mujoco.MjSpec` the meshes that stand for theirs; what nobody names is taken out."""
    before = {geom.meshname for geom in spec.geoms if geom.name in found}
    for geom in spec.geoms:
        if geom.name in found:
            vertices = found[geom.name].points.ravel().tolist()
            geom.meshname = f"for {geom.name}"
            spec.add_mesh(name=geom.meshname, uservert=vertices, scale=np.ones(3), maxhullvert=-1)
    named = {geom.meshname for geom in spec.geoms}
    for mesh in list(spec.meshes):
        if mesh.name in before - named:
            spec.delete(mesh)


def said(skeleton: Skeleton) -> tuple[str, ...]:
    """A sentence for the links of which something larger is looked at."""
    grown = {shape.link: shape.grown for shape in skeleton.shapes if shape.grown > 0.0}
    if not grown:
        return ()
    most = np.ceil(1e4 * max(shape.grown for shape in skeleton.shapes)) / 10.0
    return (
        f"The shapes themselves of {', '.join(grown)}, of more than {MANY:,} points: hulls of fewer points "
        f"that hold them, up to {most:.1f} mm larger, are looked at in their place.",
    )
