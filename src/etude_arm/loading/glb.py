"""Triangles of binary glTF 2.0 (.glb), which newer descriptions draw with.

Coordinates are taken as they stand in the file, as RViz and three.js take them: glTF calls y upwards, but
what stands in a URDF is in the frame of its link.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from etude.types import Array, Index

MAGIC, HEAD = b"glTF", 12
TYPES = {5121: "u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
SIZES = {"SCALAR": 1, "VEC3": 3}
TRIANGLES = 4
DEEPEST = 100


def glb_triangles(data: bytes) -> Array:
    """(n, 3, 3) corners of all triangles that the scene shows, m.

    Raises:
        ValueError: no binary glTF 2.0, or one that is compressed or keeps its numbers in other files.
    """
    content, numbers = _chunks(data)
    scenes = content.get("scenes", [])
    roots = (
        scenes[content.get("scene", 0)].get("nodes", []) if scenes else range(len(content.get("nodes", [])))
    )
    found = [part for root in roots for part in _shown(content, numbers, root, np.eye(4), 0)]
    return np.concatenate(found) if found else np.zeros((0, 3, 3))


def _chunks(data: bytes) -> tuple[dict[str, Any], bytes]:
    """The JSON and the numbers."""
    if data[:4] != MAGIC or int.from_bytes(data[4:8], "little") != 2:
        raise ValueError("this is no binary glTF of version 2")
    chunks, at = {}, HEAD
    while at + 8 <= len(data):
        size = int.from_bytes(data[at : at + 4], "little")
        chunks[data[at + 4 : at + 8]] = data[at + 8 : at + 8 + size]
        at += 8 + size
    return json.loads(chunks[b"JSON"]), chunks.get(b"BIN\0", b"")


def _shown(content: dict[str, Any], numbers: bytes, at: int, above: Array, depth: int) -> Iterator[Array]:
    """The triangles of a node and of those below it, in the scene's frame."""
    if depth > DEEPEST:
        raise ValueError("its nodes hang on each other in a circle")
    node = content["nodes"][at]
    frame = above @ _frame(node)
    if "mesh" in node:
        for primitive in content["meshes"][node["mesh"]]["primitives"]:
            if primitive.get("mode", TRIANGLES) == TRIANGLES:
                yield _corners(content, numbers, primitive) @ frame[:3, :3].T + frame[:3, 3]
    for child in node.get("children", []):
        yield from _shown(content, numbers, child, frame, depth + 1)


def _frame(node: dict[str, Any]) -> Array:
    """(4, 4) of a node in the one above: its matrix, or its shift, turn (x, y, z, w) and scale."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=float).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    u, s = np.array([x, y, z]), np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn = (w * w - u @ u) * np.eye(3) + 2.0 * np.outer(u, u) + 2.0 * w * s
    found = np.eye(4)
    found[:3, :3] = turn * np.array(node.get("scale", (1.0, 1.0, 1.0)))
    found[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return found


def _corners(content: dict[str, Any], numbers: bytes, primitive: dict[str, Any]) -> Array:
    points: Array = _accessed(content, numbers, primitive["attributes"]["POSITION"]).astype(float)
    if "indices" not in primitive:
        return np.asarray(points.reshape(-1, 3, 3))
    indices: Index = _accessed(content, numbers, primitive["indices"])[:, 0].astype(np.int64)
    return np.asarray(points[indices.reshape(-1, 3)])


def _accessed(content: dict[str, Any], numbers: bytes, at: int) -> Any:
    """(count, size) numbers of an accessor."""
    accessor = content["accessors"][at]
    if "bufferView" not in accessor or "sparse" in accessor:
        raise ValueError("its numbers are compressed")
    view = content["bufferViews"][accessor["bufferView"]]
    if content["buffers"][view["buffer"]].get("uri"):
        raise ValueError("its numbers are in another file")
    dtype, size = np.dtype(TYPES[accessor["componentType"]]), SIZES[accessor["type"]]
    start, count = view.get("byteOffset", 0) + accessor.get("byteOffset", 0), accessor["count"]
    step = (view.get("byteStride", size * dtype.itemsize), dtype.itemsize)
    needed = (count - 1) * step[0] + size * step[1]
    if start + needed > len(numbers):
        raise ValueError("it ends before its numbers do")
    return np.ndarray((count, size), dtype, numbers, start, step)
