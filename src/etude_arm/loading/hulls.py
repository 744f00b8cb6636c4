"""Convex hulls of meshes, as OBJ text: the shape that MuJoCo would take of a mesh anyway."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from etude.types import Array, Index

THINNEST = 1e-4
"""m: thinner parts are made that thick, since a flat hull has no inside."""
MADE = b"# the convex hull of a mesh\n"
"""Begins the files that `obj_text` writes."""


def hull(points: Array) -> tuple[Array, Index]:
    """Vertices (v, 3) and triangles (f, 3) of the convex hull of points (n, 3); normals point outwards.

    It contains every point, and more only where the points are flatter than THINNEST.
    """
    points = _thickened(points)
    try:
        found = ConvexHull(points)
    except QhullError:  # nearly flat: let it move points by rounding errors
        found = ConvexHull(points, qhull_options="QJ")
    kept, faces = np.unique(found.simplices, return_inverse=True)
    faces = faces.reshape(-1, 3)
    vertices = points[kept]
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    inwards = np.einsum("fi,fi->f", np.cross(b - a, c - a), found.equations[:, :3]) < 0
    faces[inwards] = faces[inwards][:, ::-1]
    return vertices, faces


def _thickened(points: Array) -> Array:
    """The points, doubled to both sides in directions in which they have no extent."""
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
