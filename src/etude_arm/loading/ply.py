"""Triangles of PLY files (Turk, "The PLY Polygon File Format", 1994): ASCII, and binary of either order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from etude.types import Array
from etude_arm.loading.collada import fans

KINDS = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass
class _Element:
    """`count` rows of properties, each (name, kind, kind of a list's length or "")."""

    name: str
    count: int
    properties: list[tuple[str, str, str]] = field(default_factory=list)


def ply_triangles(data: bytes) -> Array:
    """(n, 3, 3) corners; a file without faces gives its vertices thrice.

    Raises:
        ValueError, LookupError: the file is no PLY, or shorter than it says.
    """
    head, end, body = data.partition(b"end_header")
    lines = [line.split() for line in head.decode("ascii", "replace").splitlines()]
    if not end or lines[:1] != [["ply"]]:
        raise ValueError("no header of a PLY file")
    order = ORDERS[next(words[1] for words in lines if words[:1] == ["format"])]
    body = body.partition(b"\n")[2]
    read = _Binary(body, order) if order else _Ascii(body)
    points, faces = np.empty((0, 3)), list[list[float]]()
    for element in _elements(lines):
        rows = [dict(read.row(element)) for _ in range(element.count)]
        if element.name == "vertex":
            points = np.array([[row[axis][0] for axis in "xyz"] for row in rows], dtype=float).reshape(-1, 3)
        elif element.name == "face":
            faces = [row["vertex_indices" if "vertex_indices" in row else "vertex_index"] for row in rows]
    if not faces:
        return np.repeat(points[:, None], 3, axis=1)
    corners = np.array([int(corner) for face in faces for corner in face])
    return points[fans(corners, [len(face) for face in faces])]


def _elements(lines: Sequence[Sequence[str]]) -> list[_Element]:
    found: list[_Element] = []
    for words in lines:
        if words[:1] == ["element"]:
            found.append(_Element(words[1], int(words[2])))
        elif words[:2] == ["property", "list"]:
            found[-1].properties.append((words[4], KINDS[words[3]], KINDS[words[2]]))
        elif words[:1] == ["property"]:
            found[-1].properties.append((words[2], KINDS[words[1]], ""))
    return found


class _Ascii:
    """Numbers as words, one row after the other; a property that is no list is a list of one."""

    def __init__(self, body: bytes) -> None:
        self.words = iter(body.split())

    def row(self, element: _Element) -> Iterator[tuple[str, list[float]]]:
        for name, _, length in element.properties:
            yield name, [self._next() for _ in range(int(self._next()) if length else 1)]

    def _next(self) -> float:
        word = next(self.words, None)
        if word is None:
            raise ValueError("the file is shorter than its header says")
        return float(word)


class _Binary:
    """Numbers as bytes, one row after the other."""

    def __init__(self, body: bytes, order: str) -> None:
        self.body, self.order, self.at = body, order, 0

    def row(self, element: _Element) -> Iterator[tuple[str, list[float]]]:
        for name, kind, length in element.properties:
            yield name, self._next(kind, int(self._next(length, 1)[0]) if length else 1)

    def _next(self, kind: str, count: int) -> list[float]:
        found = np.frombuffer(self.body, self.order + kind, count, self.at)  # ValueError beyond the end
        self.at += found.nbytes
        return [float(value) for value in found]
