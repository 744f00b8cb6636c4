"""Triangles of COLLADA files (.dae), placed by the scene, in metres.

Files carry vertices that no primitive uses, and units other than the metre. The axis that the file calls up
is left as it is: so does ROS, and descriptions are written for it.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence

import numpy as np

from etude.types import Array, Index
from etude_arm.physics.kinematics import axis_rotation

PRIMITIVES = ("triangles", "polylist", "polygons", "tristrips", "trifans")


def collada_triangles(data: bytes) -> Array:
    """(n, 3, 3) corners in m. ValueError or LookupError if the file is no COLLADA."""
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
    """Triangles of what a node holds, in the scene's frame."""
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
    """A skin as it is bound, without its bones."""
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
    """Triangles of a geometry; vertices that no primitive uses are none of it."""
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
    """(n, 3) corners of the triangles of polygons, whose corners stand one after another."""
    many = np.array(counts)
    first = np.cumsum(many) - many
    found = [np.zeros((0, 3), dtype=np.int64)]
    for i in range(1, int(many.max(initial=0)) - 1):
        start = first[many > i + 1]
        found.append(corners[np.stack([start, start + i, start + i + 1], axis=1)])
    return np.concatenate(found)


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
