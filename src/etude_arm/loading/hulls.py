"""Convex hulls of meshes, as OBJ text: MuJoCo collides meshes by their hulls.

The hull of a bent link encloses much empty space. Hulls of slabs enclose less: the triangles are clipped at
planes across the longest side, and the hulls of the slabs together contain the mesh.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from etude.types import Array, Index

THINNEST = 1e-4
"""m: thinner meshes are thickened to this size, since a flat hull has no volume."""
MADE = b"# the convex hull of a mesh\n"
"""Begins the files that `obj_text` writes."""


def hull(points: Array) -> tuple[Array, Index]:
    """Vertices (v, 3) and triangles (f, 3) of the convex hull of points (n, 3); normals point outwards.

    It contains every point, and more only where the points are flatter than THINNEST.
    """
    points = _thickened(points)
    try:
        convex = ConvexHull(points)
    except QhullError:  # nearly flat: QJ moves points by rounding errors
        convex = ConvexHull(points, qhull_options="QJ")
    corners, faces = np.unique(convex.simplices, return_inverse=True)
    faces = faces.reshape(-1, 3)
    vertices = points[corners]
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    inwards = np.einsum("fi,fi->f", np.cross(b - a, c - a), convex.equations[:, :3]) < 0
    faces[inwards] = faces[inwards][:, ::-1]
    return vertices, faces


def _thickened(points: Array) -> Array:
    """The points, with copies on both sides along directions in which they have no extent."""
    centred = points - points.mean(axis=0)
    _, _, axes = np.linalg.svd(centred, full_matrices=True) if len(points) < 4 else _principal(centred)
    for axis in axes:
        if np.ptp(points @ axis) < THINNEST:
            points = np.concatenate([points - 0.5 * THINNEST * axis, points + 0.5 * THINNEST * axis])
    return points


def _principal(centred: Array) -> tuple[None, None, Array]:
    return None, None, np.linalg.eigh(centred.T @ centred)[1].T


def is_hull(data: bytes) -> bool:
    """Whether a mesh file is what `obj_text` writes: hulls of fine CAD take long to be made again."""
    return data.startswith(MADE)


def obj_text(vertices: Array, faces: Index) -> bytes:
    """OBJ of a triangle mesh; indices begin at 1 there."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    return MADE + ("\n".join(lines) + "\n").encode()


SLABS = 4
"""Number of slabs of a bent mesh; more do not reduce the volume."""
WORTH = 0.8
"""Slabs are taken if their hulls have less than this part of the whole hull's volume."""


def slabs(triangles: Array) -> list[Array]:
    """Points (m, 3) whose hulls contain the mesh of triangles (n, 3, 3), SLABS of them or the whole one."""
    whole = triangles.reshape(-1, 3)
    side = int(np.argmax(np.ptp(whole, axis=0)))
    planes = np.linspace(whole[:, side].min(), whole[:, side].max(), SLABS + 1)
    parts = [_between(triangles, side, low, high) for low, high in pairwise(planes)]
    parts = [part for part in parts if len(part)]
    if sum(volume(part) for part in parts) < WORTH * volume(whole):
        return parts
    return [whole]


def _between(triangles: Array, side: int, low: float, high: float) -> Array:
    """Corners of the triangles between two planes, and where edges cross the planes."""
    corners = triangles.reshape(-1, 3)
    inside = corners[(corners[:, side] >= low) & (corners[:, side] <= high)]
    start, end = corners, triangles[:, [1, 2, 0]].reshape(-1, 3)
    parts = [inside]
    for plane in (low, high):
        across = (start[:, side] - plane) * (end[:, side] - plane) < 0
        a, b = start[across], end[across]
        share = (plane - a[:, side]) / (b[:, side] - a[:, side])
        parts.append(a + share[:, None] * (b - a))
    return np.concatenate(parts)


def volume(points: Array) -> float:
    """Volume of the hull of points, m^3."""
    vertices, faces = hull(points)
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    # tetrahedra from the origin to each face: a · (b x c) / 6
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6)
