"""Hull reduction: a hull of few points that, grown by a radius, contains a hull of many.

Points are taken greedily: of each facet of what is held so far the one that stands farthest out. The radius
is the largest distance of any point from the hull of those taken, by closed forms: what is nearest to a point
outside of a convex body lies on a facet that the point is in front of. So the grown hull holds every point,
and since those taken are among them, nothing of it is farther than the radius from the hull of all.

Whatever is searched and proved is then about something larger than the shape. Where two shapes stand so close
at home that this would take much of their room, they stay as they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from etude.types import Array, Index
from etude_arm.clearance.distances import Gaps
from etude_arm.clearance.skeleton import Shape, Skeleton

MOST_POINTS = 256
"""Points that are taken at most."""
CLOSE = 5e-4
"""m: a radius below which no more are taken."""
SHARE = 0.6
"""Of the farthest point's height over its facet: points that stand out less wait for the next round."""
FLAT = 1e-9
"""m, about: points that span less have no hull."""
TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True, eq=False)
class Fewer:
    """All that is within `radius` m of the hull of `points` (V, 3) m."""

    points: Array
    radius: float


def fewer(points: Array, most: int = MOST_POINTS, close: float = CLOSE) -> Fewer:
    """At most `most` of points (n, 3) that span a volume, with a radius that holds the others.

    Fewer are taken if a radius of `close` m is enough for them.
    """
    taken = _first(points)
    while True:
        hull = ConvexHull(points[taken])
        heights = points @ hull.equations[:, :3].T + hull.equations[:, 3]
        if len(taken) >= most or heights.max() <= close:
            break
        taken = np.concatenate([taken, _farthest(heights, most - len(taken), close)])
    beyond = outside(points, points[taken][hull.simplices], heights)
    return Fewer(points[taken], float(beyond.max()))


def _first(points: Array) -> Index:
    """The outermost along axes and diagonals; where these are flat, four more that are not."""
    signs = np.array([sign for sign in product((-1.0, 0.0, 1.0), repeat=3) if any(sign)])
    taken = np.unique((points @ signs.T).argmax(axis=0))
    if np.linalg.matrix_rank(points[taken] - points[taken[0]], tol=FLAT) == 3:
        return taken
    corners, rest = [0], points - points[0]
    for _ in range(3):  # the farthest from the point, the line, the plane so far
        lengths = np.linalg.norm(rest, axis=1)
        corners.append(int(lengths.argmax()))
        along = rest[corners[-1]] / lengths.max()
        rest = rest - np.outer(rest @ along, along)
    return np.unique([*taken, *corners])


def _farthest(heights: Array, room: int, close: float) -> Index:
    """At most `room` points that stand out most of heights (n, f) over the facets, one a facet."""
    tops = heights.max(axis=0)
    facets = np.argsort(-tops)
    facets = facets[tops[facets] > max(SHARE * tops.max(), close)]
    return np.array(list(dict.fromkeys(heights[:, facets].argmax(axis=0).tolist()))[:room])


def outside(points: Array, triangles: Array, heights: Array) -> Array:
    """(n,) m by which points are outside a convex body, 0 for those that it holds.

    Args:
        points: (n, 3). triangles: (f, 3, 3) corners of its facets.
        heights: (n, f) of the points over the facets.
    """
    point, facet = np.nonzero(heights > 0.0)
    found = np.full(len(points), np.inf)
    np.minimum.at(found, point, to_triangles(points[point], triangles[facet]))
    return np.where(np.isinf(found), 0.0, found)


def to_triangles(points: Array, triangles: Array) -> Array:
    """(m,) m from each point (m, 3) to its triangle (m, 3, 3).

    It is the distance to a point of the triangle whatever rounding does, so never too small: to what is below
    the point or, where that is outside, to the nearest of the edges.
    """
    edges = np.roll(triangles, -1, axis=1) - triangles
    away = points[:, None] - triangles
    length = np.maximum((edges**2).sum(axis=2), TINY)
    along = np.clip((away * edges).sum(axis=2) / length, 0.0, 1.0)
    to_edges = np.linalg.norm(away - along[:, :, None] * edges, axis=2)
    normal = np.cross(edges[:, 0], edges[:, 1])
    areas = np.maximum(np.einsum("mei,mi->me", np.cross(edges, away), normal), 0.0) + TINY
    parts = np.roll(areas, -1, axis=1) / areas.sum(axis=1, keepdims=True)  # of the corner across each edge
    below = (parts[:, :, None] * triangles).sum(axis=1)
    return np.asarray(np.minimum(to_edges.min(axis=1), np.linalg.norm(points - below, axis=1)))


MANY = 1000
"""Points above which a hull of fewer stands for a shape."""
ROOM_FACTOR = 4.0
"""A gap that is narrower at home than so many times what stand-ins would take of it keeps its shapes."""


def hull_proxies(gaps: Gaps, home: Array) -> dict[str, Fewer]:
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
        if distance < ROOM_FACTOR * sum(ends):
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
    # mm, rounded up to a tenth
    most = np.ceil(1e4 * max(shape.grown for shape in skeleton.shapes)) / 10.0
    return (
        f"The shapes themselves of {', '.join(grown)}, of more than {MANY:,} points: hulls of fewer points "
        f"that hold them, up to {most:.1f} mm larger, are looked at in their place.",
    )
