"""Slabs of a mesh: a bent link's hull holds much air, the hulls of its slabs hold less.

The triangles are clipped at planes across the longest side, so that the hulls of the slabs together contain
the mesh.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from etude.types import Array
from etude_arm.loading.hulls import hull

SLABS = 4
"""More gain nothing."""
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
    found = [inside]
    for plane in (low, high):
        across = (start[:, side] - plane) * (end[:, side] - plane) < 0
        a, b = start[across], end[across]
        share = (plane - a[:, side]) / (b[:, side] - a[:, side])
        found.append(a + share[:, None] * (b - a))
    return np.concatenate(found)


def volume(points: Array) -> float:
    """Volume of the hull of points, m^3."""
    vertices, faces = hull(points)
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6)
