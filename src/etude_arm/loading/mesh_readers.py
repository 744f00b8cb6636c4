"""Triangles of STL, OBJ, COLLADA, glTF and PLY files.

COLLADA files have vertices that no primitive uses, and units other than the metre. The up axis of the file is
ignored, as ROS does, since descriptions are written for ROS.

Coordinates of glTF are used unchanged, as RViz and three.js do: glTF has y up, but a mesh of a URDF is in the
frame of its link.
"""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from etude.errors import UsageError
from etude.types import Array, Index
from etude_arm.physics.kinematics import axis_rotation

ANEW = "Export it again, or remove its shape from the model file."
POINTER = b"version https://git-lfs"
OBJ_WORDS = frozenset(b"v vt vn vp f l p g o s mg usemtl mtllib usemap maplib".split())
STL_HEAD, STL_FACET = 84, 50  # bytes
FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_triangles(path: Path) -> Array:
    """(n, 3, 3) corners of a mesh file's triangles, in m; an OBJ without faces gives its vertices thrice.

    A file without triangles is an empty mesh: manufacturers use them for links without a visible shape.

    Raises:
        UsageError: the format is unknown, or the file does not have its format.
    """
    read = READERS.get(path.suffix.lower())
    if read is None:
        raise UsageError(
            f"meshes of the form '{path.suffix}' are not read",
            where=str(path),
            next_step=f"Convert it to one of {', '.join(READERS)}, in the same folder and with the same "
            "name.",
        )
    try:
        data = path.read_bytes()
        triangles = read(data)
    except (OSError, ValueError, LookupError, SyntaxError) as problem:
        raise UsageError(f"the mesh cannot be read: {problem}", where=str(path), next_step=ANEW) from None
    if not len(triangles) and not _is_mesh(path.suffix.lower(), data):
        pointer = data.startswith(POINTER)
        raise UsageError(
            "the file holds no mesh" + (", but a pointer of Git LFS to one" if pointer else ""),
            where=str(path),
            next_step="Fetch it with git lfs pull in the cloned folder." if pointer else ANEW,
        )
    if not np.all(np.isfinite(triangles)):
        raise UsageError("the mesh has vertices that are not numbers", where=str(path), next_step=ANEW)
    return triangles


def _is_mesh(suffix: str, data: bytes) -> bool:
    """Whether a file without triangles has its format: the other readers refuse invalid files themselves."""
    if suffix == ".stl":
        return (len(data) == STL_HEAD and not any(data[80:84])) or data.lstrip().startswith(b"solid")
    if suffix == ".obj":
        keywords = {line.split(None, 1)[0] for line in data.splitlines() if line.strip()}
        return bool(keywords) and all(word in OBJ_WORDS or word.startswith(b"#") for word in keywords)
    return True


def stl_triangles(data: bytes) -> Array:
    """A file is binary if its length matches: many binary files begin with "solid", as the text format
    does.
    """
    if len(data) >= STL_HEAD:
        count = int.from_bytes(data[80:84], "little")
        if len(data) == STL_HEAD + STL_FACET * count:
            return np.frombuffer(data, FACET, offset=STL_HEAD)["corners"].astype(float)
    return _rows(data, b"vertex").reshape(-1, 3, 3)


PRIMITIVES = ("triangles", "polylist", "polygons", "tristrips", "trifans")


def collada_triangles(data: bytes) -> Array:
    """(n, 3, 3) corners in m. ValueError or LookupError if the file is not COLLADA."""
    root = ET.fromstring(data)
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    if root.tag != "COLLADA":
        raise ValueError("no COLLADA file")
    named = {element.get("id", ""): element for element in root.iter() if element.get("id")}
    unit = root.find("asset/unit")
    metre = float(unit.get("meter", "1")) if unit is not None else 1.0
    scene = root.find("scene/instance_visual_scene")
    if scene is None:
        parts = [_used(geometry, named) for geometry in root.iter("geometry")]
    else:
        parts = list(_placed(_meant(scene, named), np.eye(4), named))
    return metre * np.concatenate([*parts, np.zeros((0, 3, 3))])


def _meant(instance: ET.Element, named: dict[str, ET.Element]) -> ET.Element:
    return named[instance.get("url", instance.get("source", "")).lstrip("#")]


def _placed(node: ET.Element, pose: Array, named: dict[str, ET.Element]) -> Iterator[Array]:
    """Triangles of a node, in the scene's frame."""
    for part in node:
        pose = pose @ _step(part)
    for part in node:
        if part.tag == "node":
            yield from _placed(part, pose, named)
        elif part.tag == "instance_node":
            yield from _placed(_meant(part, named), pose, named)
        elif part.tag == "instance_geometry":
            yield _moved(_used(_meant(part, named), named), pose)
        elif part.tag == "instance_controller":
            yield from _skinned(_meant(part, named), pose, named)


def _skinned(controller: ET.Element, pose: Array, named: dict[str, ET.Element]) -> Iterator[Array]:
    """A skin in its bind pose, without its bones."""
    skin = controller.find("skin")
    if skin is not None:
        bind = skin.find("bind_shape_matrix")
        shape = np.eye(4) if bind is None else _floats(bind).reshape(4, 4)
        yield _moved(_used(_meant(skin, named), named), pose @ shape)


def _step(part: ET.Element) -> Array:
    """The transformation that a node's element states; none for other elements."""
    step = np.eye(4)
    if part.tag == "matrix":
        step = _floats(part).reshape(4, 4)
    elif part.tag == "translate":
        step[:3, 3] = _floats(part)
    elif part.tag == "scale":
        step[:3, :3] = np.diag(_floats(part))
    elif part.tag == "rotate":
        *axis, angle = _floats(part)
        step[:3, :3] = axis_rotation(np.array(axis) / np.linalg.norm(axis), np.radians([angle]))[0]
    return step


def _moved(points: Array, pose: Array) -> Array:
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


def _floats(element: ET.Element) -> Array:
    return np.array((element.text or "").split(), dtype=float)


def _used(geometry: ET.Element, named: dict[str, ET.Element]) -> Array:
    """Triangles of a geometry, without vertices that no primitive uses."""
    parts = [np.zeros((0, 3, 3))]
    for primitive in geometry.iter():
        if primitive.tag in PRIMITIVES:
            inputs = primitive.findall("input")
            stride = 1 + max(int(entry.get("offset", "0")) for entry in inputs)
            vertex = next(entry for entry in inputs if entry.get("semantic") == "VERTEX")
            points = _positions(_meant(vertex, named), named)
            counts = primitive.find("vcount")
            for indices in primitive.findall("p"):
                numbers = np.array((indices.text or "").split(), dtype=np.int64)
                corners = numbers[int(vertex.get("offset", "0")) :: stride]
                parts.append(points[_triangles(primitive.tag, corners, counts)])
    return np.concatenate(parts)


def _triangles(kind: str, corners: Index, counts: ET.Element | None) -> Index:
    """(n, 3) corners of the triangles of one primitive's <p>."""
    if kind == "triangles":
        return corners.reshape(-1, 3)
    if kind == "tristrips":
        return np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
    if kind == "polylist" and counts is not None:
        return fans(corners, [int(count) for count in (counts.text or "").split()])
    return fans(corners, [len(corners)])


def fans(corners: Index, counts: Sequence[int]) -> Index:
    """(n, 3) corners of the triangles of polygons, given as a sequence of corners."""
    many = np.array(counts)
    first = np.cumsum(many) - many
    triangles = [np.zeros((0, 3), dtype=np.int64)]
    for i in range(1, int(many.max(initial=0)) - 1):
        start = first[many > i + 1]
        triangles.append(corners[np.stack([start, start + i, start + i + 1], axis=1)])
    return np.concatenate(triangles)


def _positions(vertices: ET.Element, named: dict[str, ET.Element]) -> Array:
    source = next(entry for entry in vertices.findall("input") if entry.get("semantic") == "POSITION")
    data = _meant(source, named)
    accessor, values = data.find("technique_common/accessor"), data.find("float_array")
    if values is None:
        raise LookupError("positions without numbers")
    stride = 3 if accessor is None else int(accessor.get("stride", "3"))
    offset = 0 if accessor is None else int(accessor.get("offset", "0"))
    numbers = _floats(values)[offset:]
    return numbers[: len(numbers) // stride * stride].reshape(-1, stride)[:, :3]


def obj_triangles(data: bytes) -> Array:
    points = _rows(data, b"v")
    faces = [line.split()[1:] for line in data.splitlines() if line.split(None, 1)[:1] == [b"f"]]
    if not faces:
        return np.repeat(points[:, None], 3, axis=1)
    corners = [int(corner.partition(b"/")[0]) for face in faces for corner in face]
    indices = np.array([corner - 1 if corner > 0 else corner for corner in corners])
    return points[fans(indices, [len(face) for face in faces])]


def _rows(data: bytes, word: bytes) -> Array:
    """The first three numbers of every line that begins with `word`."""
    rows = [line.split()[1:4] for line in data.splitlines() if line.split(None, 1)[:1] == [word]]
    return np.array(rows, dtype=float).reshape(-1, 3)


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
        ValueError, LookupError: the file is not PLY, or shorter than its header states.
    """
    head, end, body = data.partition(b"end_header")
    lines = [line.split() for line in head.decode("ascii", "replace").splitlines()]
    if not end or lines[:1] != [["ply"]]:
        raise ValueError("no header of a PLY file")
    order = ORDERS[next(tokens[1] for tokens in lines if tokens[:1] == ["format"])]
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
    elements: list[_Element] = []
    for tokens in lines:
        if tokens[:1] == ["element"]:
            elements.append(_Element(tokens[1], int(tokens[2])))
        elif tokens[:2] == ["property", "list"]:
            elements[-1].properties.append((tokens[4], KINDS[tokens[3]], KINDS[tokens[2]]))
        elif tokens[:1] == ["property"]:
            elements[-1].properties.append((tokens[2], KINDS[tokens[1]], ""))
    return elements


class _Ascii:
    """Numbers of a text file row by row; a scalar property counts as a list of one."""

    def __init__(self, body: bytes) -> None:
        self.words = iter(body.split())

    def row(self, element: _Element) -> Iterator[tuple[str, list[float]]]:
        for name, _, length in element.properties:
            yield name, [self._next() for _ in range(int(self._next()) if length else 1)]

    def _next(self) -> float:
        word = next(self.words, None)
        if word is None:
            raise ValueError("the file is shorter than its header states")
        return float(word)


class _Binary:
    """Numbers of a binary file row by row."""

    def __init__(self, body: bytes, order: str) -> None:
        self.body, self.order, self.at = body, order, 0

    def row(self, element: _Element) -> Iterator[tuple[str, list[float]]]:
        for name, kind, length in element.properties:
            yield name, self._next(kind, int(self._next(length, 1)[0]) if length else 1)

    def _next(self, kind: str, count: int) -> list[float]:
        numbers = np.frombuffer(self.body, self.order + kind, count, self.at)  # ValueError beyond the end
        self.at += numbers.nbytes
        return [float(value) for value in numbers]


MAGIC, HEAD = b"glTF", 12
TYPES = {5121: "u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
SIZES = {"SCALAR": 1, "VEC3": 3}
TRIANGLES = 4  # glTF: the mode of a primitive made of triangles
DEEPEST = 100  # levels of nodes: deeper ones are a loop


def glb_triangles(data: bytes) -> Array:
    """(n, 3, 3) corners of all triangles that the scene shows, m.

    Raises:
        ValueError: not a binary glTF 2.0, or compressed, or with numbers in other files.
    """
    content, numbers = _chunks(data)
    scenes = content.get("scenes", [])
    roots = (
        scenes[content.get("scene", 0)].get("nodes", []) if scenes else range(len(content.get("nodes", [])))
    )
    parts = [part for root in roots for part in _shown(content, numbers, root, np.eye(4), 0)]
    return np.concatenate(parts) if parts else np.zeros((0, 3, 3))


def _chunks(data: bytes) -> tuple[dict[str, Any], bytes]:
    """The JSON and the numbers."""
    if data[:4] != MAGIC or int.from_bytes(data[4:8], "little") != 2:
        raise ValueError("this is not binary glTF of version 2")
    chunks, at = {}, HEAD
    while at + 8 <= len(data):
        size = int.from_bytes(data[at : at + 4], "little")
        chunks[data[at + 4 : at + 8]] = data[at + 8 : at + 8 + size]
        at += 8 + size
    return json.loads(chunks[b"JSON"]), chunks.get(b"BIN\0", b"")


def _shown(content: dict[str, Any], numbers: bytes, at: int, above: Array, depth: int) -> Iterator[Array]:
    """The triangles of a node and of those below it, in the scene's frame."""
    if depth > DEEPEST:
        raise ValueError("its nodes form a circle")
    node = content["nodes"][at]
    frame = above @ _frame(node)
    if "mesh" in node:
        for primitive in content["meshes"][node["mesh"]]["primitives"]:
            if primitive.get("mode", TRIANGLES) == TRIANGLES:
                yield _corners(content, numbers, primitive) @ frame[:3, :3].T + frame[:3, 3]
    for child in node.get("children", []):
        yield from _shown(content, numbers, child, frame, depth + 1)


def _frame(node: dict[str, Any]) -> Array:
    """(4, 4) transformation of a node in its parent: its matrix, or translation, rotation (x, y, z, w) and
    scale.
    """
    if "matrix" in node:
        return np.array(node["matrix"], dtype=float).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    u, s = np.array([x, y, z]), np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn = (w * w - u @ u) * np.eye(3) + 2.0 * np.outer(u, u) + 2.0 * w * s
    transform = np.eye(4)
    transform[:3, :3] = turn * np.array(node.get("scale", (1.0, 1.0, 1.0)))
    transform[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return transform


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
        raise ValueError("it ends before its numbers")
    return np.ndarray((count, size), dtype, numbers, start, step)


READERS: Mapping[str, Callable[[bytes], Array]] = {
    ".stl": stl_triangles,
    ".obj": obj_triangles,
    ".dae": collada_triangles,
    ".ply": ply_triangles,
    ".glb": glb_triangles,
}
