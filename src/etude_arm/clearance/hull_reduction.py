"""Hull reduction: a hull of few points whose growth by a radius contains a hull of many.

Points are taken greedily: for each facet of the present hull, the point that stands farthest out. The radius
is the largest distance of any point from the hull of the taken points, by closed forms. The nearest point of
a convex body to a point outside lies on a facet that this point is in front of. So the enlarged hull contains
every point. The taken points are among them, so no point of the enlarged hull is farther than the radius from
the full hull.

Searches and proofs then concern something larger than the shape. Two shapes that are so close at home that
this would take much of their distance stay as they are.
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
    """All points within `radius` m of the hull of `points` (V, 3) m."""

    points: Array
    radius: float


def fewer(points: Array, most: int = MOST_POINTS, close: float = CLOSE) -> Fewer:
    """At most `most` of points (n, 3) m that span a volume, with a radius that covers the others.

    Fewer points are taken if a radius of `close` m suffices.
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
    """The outermost points along axes and diagonals; if these are flat, four points that are not."""
    signs = np.array([sign for sign in product((-1.0, 0.0, 1.0), repeat=3) if any(sign)])
    taken = np.unique((points @ signs.T).argmax(axis=0))
    if np.linalg.matrix_rank(points[taken] - points[taken[0]], tol=FLAT) == 3:
        return taken
    corners, residuals = [0], points - points[0]
    for _ in range(3):  # the farthest from the point, the line, the plane so far
        lengths = np.linalg.norm(residuals, axis=1)
        corners.append(int(lengths.argmax()))
        along = residuals[corners[-1]] / lengths.max()
        residuals = residuals - np.outer(residuals @ along, along)
    return np.unique([*taken, *corners])


def _farthest(heights: Array, room: int, close: float) -> Index:
    """At most `room` points, one for each facet, with the largest heights (n, f) over the facets."""
    tops = heights.max(axis=0)
    facets = np.argsort(-tops)
    facets = facets[tops[facets] > max(SHARE * tops.max(), close)]
    return np.array(list(dict.fromkeys(heights[:, facets].argmax(axis=0).tolist()))[:room])


def outside(points: Array, triangles: Array, heights: Array) -> Array:
    """Distances (n,) m of points outside a convex body; 0 for points inside.

    Args:
        points: (n, 3) m. triangles: (f, 3, 3) corners of the facets, m.
        heights: (n, f) of the points over the facets, m.
    """
    point, facet = np.nonzero(heights > 0.0)
    distances = np.full(len(points), np.inf)
    np.minimum.at(distances, point, to_triangles(points[point], triangles[facet]))
    return np.where(np.isinf(distances), 0.0, distances)


def to_triangles(points: Array, triangles: Array) -> Array:
    """Distances (m,) m from each point (m, 3) to its triangle (m, 3, 3).

    Rounding cannot make it too small, because it is the distance to some point of the triangle. This is the
    point below or, if that lies outside, the nearest point of the edges.
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
    """Reduced hulls by the names of their shapes, in m in the frame that the model file gives to the meshes.

    Args:
        gaps: of the original shapes. home: (k,) pose, rad (m).
    """
    shapes = gaps.skeleton.shapes
    looked_at = {i for gap in gaps.list for i in (gap.one, gap.other) if i >= 0}
    hulls = {i: fewer(shapes[i].points) for i in sorted(looked_at) if len(shapes[i].points) > MANY}
    if not hulls:
        return {}
    for gap, distance in zip(gaps.list, gaps.of_poses(home[None])[0], strict=True):
        ends = [hulls[i].radius for i in (gap.one, gap.other) if i in hulls]
        if distance < ROOM_FACTOR * sum(ends):
            hulls = {i: one for i, one in hulls.items() if i not in (gap.one, gap.other)}
    return {shapes[i].name: _in_file(gaps.skeleton, shapes[i], one) for i, one in hulls.items()}


def _in_file(skeleton: Skeleton, shape: Shape, hull: Fewer) -> Fewer:
    """A hull in the file's frame of the mesh; MuJoCo turns a compiled geom to its axes of inertia."""
    import mujoco

    mesh = int(skeleton.model.geom_dataid[shape.geom])
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, skeleton.model.mesh_quat[mesh])
    return replace(hull, points=hull.points @ turn.reshape(3, 3).T + skeleton.model.mesh_pos[mesh])


def put(spec: Any, hulls: Mapping[str, Fewer]) -> None:
    """Replaces geoms of a `mujoco.MjSpec` by their reduced hulls, and removes meshes without users."""
    before = {geom.meshname for geom in spec.geoms if geom.name in hulls}
    for geom in spec.geoms:
        if geom.name in hulls:
            vertices = hulls[geom.name].points.ravel().tolist()
            geom.meshname = f"for {geom.name}"
            spec.add_mesh(name=geom.meshname, uservert=vertices, scale=np.ones(3), maxhullvert=-1)
    named = {geom.meshname for geom in spec.geoms}
    for mesh in list(spec.meshes):
        if mesh.name in before - named:
            spec.delete(mesh)


def hull_sentences(skeleton: Skeleton) -> tuple[str, ...]:
    """A sentence that names the links with a reduced, larger hull; () without such links."""
    links = {shape.link: shape.thickness for shape in skeleton.shapes if shape.thickness > 0.0}
    if not links:
        return ()
    # mm, rounded up to a tenth
    most = np.ceil(1e4 * max(shape.thickness for shape in skeleton.shapes)) / 10.0
    return (
        f"The exact shapes of {', '.join(links)}, with more than {MANY:,} points: hulls of fewer "
        f"points that contain them, up to {most:.1f} mm larger, are used instead.",
    )
