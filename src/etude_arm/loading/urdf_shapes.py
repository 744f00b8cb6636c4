"""Collision shapes of a URDF's links: boxes and the like as they are, meshes as convex hulls.

Where a part that moves as one has no collision shape at all, what is drawn of it is taken; where a mesh is
missing, the one that is drawn, and at last a guess, which is said.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from etude.types import Array
from etude_arm.loading.hulls import hull, is_hull, obj_text
from etude_arm.loading.mesh_paths import MeshPaths
from etude_arm.loading.mesh_readers import read_triangles
from etude_arm.loading.urdf_checks import scale_of, vector
from etude_arm.loading.urdf_primitives import check_primitive
from etude_arm.loading.urdf_tree import UrdfTree, parent

SLENDER = 0.25
"""Radius of a guessed shape by the distance to the next joint."""


@dataclass(frozen=True)
class Shapes:
    """<collision> elements by link, and the meshes they name. Other attributes as of `loaded.Loaded`."""

    elements: Mapping[str, Sequence[ET.Element]]
    assets: Mapping[str, bytes]
    notes: tuple[str, ...] = ()
    unseen: tuple[str, ...] = ()


NO_SHAPES = Shapes({}, {})


@dataclass
class _Meshes:
    """The meshes of one model file, each read once; `missing` were not found, `empty` show nothing."""

    model: Path
    paths: MeshPaths
    assets: dict[str, bytes] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)
    empty: list[str] = field(default_factory=list)
    _read: dict[Path, Array] = field(default_factory=dict)

    def add(self, mesh: ET.Element, link: str) -> str:
        """The name of an asset with the hull of a <mesh>; "" if there is no such file, or nothing in it."""
        name = mesh.get("filename", "")
        path = self.paths.find(name)
        if path is None:
            self.missing.append(name)
            return ""
        scale = scale_of(mesh, f"{self.model}, link '{link}'")
        made = self._hull(path, scale)
        if not made:
            self.empty.append(name)
            return ""
        asset = f"{len(self.assets)}_{re.sub(r'[^A-Za-z0-9_-]', '_', link)}.obj"
        self.assets[asset] = made
        return asset

    def _hull(self, path: Path, scale: Array) -> bytes:
        data = path.read_bytes() if path.suffix == ".obj" else b""
        if is_hull(data) and np.all(scale == 1.0):
            return data
        if path not in self._read:
            self._read[path] = read_triangles(path).reshape(-1, 3)
        return obj_text(*hull(self._read[path] * scale)) if len(self._read[path]) else b""


def shapes_of(tree: UrdfTree, joints: Sequence[str], path: Path, mesh_roots: Sequence[Path]) -> Shapes:
    """The collision shapes of every link, named "link#k".

    Raises:
        UsageError: a mesh that is there cannot be read.
    """
    links = tree.links.values()
    named = tuple(mesh.get("filename", "") for link in links for mesh in link.iter("mesh"))
    meshes = _Meshes(path, MeshPaths(path, mesh_roots, named))
    elements: dict[str, list[ET.Element]] = {}
    notes: list[str] = []
    unseen: list[str] = []
    drawn: list[str] = []
    for cluster in tree.clusters(joints):
        solid = any(tree.links[name].find("collision") is not None for name in cluster)
        for name in cluster:
            elements[name] = _of_link(tree, name, "collision" if solid else "visual", meshes, unseen)
        shaped = [name for name in cluster if elements[name]]
        drawn += [] if solid else shaped
        unseen += [] if shaped else [f"the shape of link '{cluster[0]}': the file has none"]
    if drawn:
        notes.append(f"What is drawn of {', '.join(drawn)} is taken as shape: there is none for collisions.")
    notes += meshes.paths.notes
    if meshes.missing:
        names = ", ".join(map(meshes.paths.in_words, dict.fromkeys(meshes.missing)))
        notes.append(
            f"Meshes are missing: {names}. Name the folder that holds them, or their package, with "
            "--mesh-root."
        )
    if meshes.empty:
        names = ", ".join(dict.fromkeys(meshes.empty))
        notes.append(f"Meshes are empty: {names}. Has the link no shape? Else export them anew.")
    return Shapes(elements, meshes.assets, tuple(notes), tuple(unseen))


def _of_link(tree: UrdfTree, link: str, kind: str, meshes: _Meshes, unseen: list[str]) -> list[ET.Element]:
    """The new <collision> elements of one link, of its <collision> or <visual> elements."""
    found: list[ET.Element] = []
    for shape in tree.links[link].findall(kind):
        found += _of_shape(shape, link, meshes) or _stand_in(tree, link, kind, meshes, unseen)
    for k, element in enumerate(found):
        element.set("name", f"{link}#{k}")
    return found


def _of_shape(shape: ET.Element, link: str, meshes: _Meshes) -> list[ET.Element]:
    """The new element of a shape; none if its mesh is missing or empty."""
    mesh, geometry = shape.find("geometry/mesh"), shape.find("geometry")
    new, place = ET.Element("collision"), f"{meshes.model}, link '{link}'"
    for origin in shape.findall("origin"):
        for key in ("xyz", "rpy"):
            vector(origin.get(key), "0 0 0", place)
    new.extend(shape.findall("origin"))
    if mesh is None:
        if geometry is None or not len(geometry):
            return []
        check_primitive(geometry[0], place)
        new.append(geometry)
        return [new]
    asset = meshes.add(mesh, link)
    if asset:
        ET.SubElement(ET.SubElement(new, "geometry"), "mesh", filename=asset)
    return [new] if asset else []


def _stand_in(tree: UrdfTree, link: str, kind: str, meshes: _Meshes, unseen: list[str]) -> list[ET.Element]:
    """What is drawn of a link whose collision mesh is missing or empty; else a capsule to the next joint, a
    guess.
    """
    lack = _lack(tree.links[link], kind, meshes)
    if kind == "collision":
        drawn = [
            new for shape in tree.links[link].findall("visual") for new in _of_shape(shape, link, meshes)
        ]
        if drawn:
            unseen.append(f"the shape of link '{link}': {lack}, what is drawn was taken")
            return drawn
    ends = [_offset(joint) for joint in tree.joints if parent(joint) == link]
    end = max(ends, key=lambda at: float(at @ at), default=np.zeros(3))
    if not end.any():  # the last link: nothing says how far it reaches
        unseen.append(f"the shape of link '{link}': {lack}, and nothing was taken in its place")
        return []
    unseen.append(f"the shape of link '{link}': {lack}, a capsule was guessed")
    return [_capsule(end)]


def _lack(link: ET.Element, kind: str, meshes: _Meshes) -> str:
    """Why a link lacks a shape."""
    names = [mesh.get("filename", "") for shape in link.findall(kind) for mesh in shape.iter("mesh")]
    return f"its mesh is {'missing' if any(name in meshes.missing for name in names) else 'empty'}"


def _offset(joint: ET.Element) -> Array:
    origin = joint.find("origin")
    return vector(None if origin is None else origin.get("xyz"), "0 0 0")


def _capsule(end: Array) -> ET.Element:
    """A capsule from the link's origin to `end` (3,)."""
    length = float(np.linalg.norm(end))
    yaw, pitch = np.arctan2(end[1], end[0]), np.arctan2(np.hypot(end[0], end[1]), end[2])
    new = ET.Element("collision")
    ET.SubElement(
        new, "origin", xyz=" ".join(map(str, (end / 2).tolist())), rpy=f"0 {float(pitch)} {float(yaw)}"
    )
    shape = {"radius": str(SLENDER * length), "length": str(length)}
    ET.SubElement(ET.SubElement(new, "geometry"), "capsule", shape)
    return new
