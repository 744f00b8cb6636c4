"""Flat faces cut to the room that a drawing shows."""

from __future__ import annotations

import numpy as np

from etude.types import Array


def cut(face: Array, lower: Array, upper: Array) -> Array:
    """(V', 3) what of a convex polygon (V, 3) or a line (2, 3) lies between two corners (3,), if anything."""
    for axis in range(3):
        face = _half(face, axis, float(lower[axis]), 1.0)
        face = _half(face, axis, float(upper[axis]), -1.0)
    return face


def _half(face: Array, axis: int, end: float, side: float) -> Array:
    """What of it is on one side of a plane across an axis: beyond `end` for 1, before it for -1."""
    beyond = side * (face[:, axis] - end)
    kept: list[Array] = []
    for k in range(len(face)):
        after = (k + 1) % len(face)
        if beyond[k] >= 0.0:
            kept.append(face[k])
        if beyond[k] * beyond[after] < 0.0:
            share = beyond[k] / (beyond[k] - beyond[after])
            kept.append(face[k] + share * (face[after] - face[k]))
    return np.array(kept).reshape(-1, 3)
