"""URDF conversion for MuJoCo: chosen joints, convex hulls, valid inertias.

MuJoCo reads URDF, but not mesh names of ROS and no zero inertia. So a new file is written from the relevant
elements, instead of patching the old one.

A rigid part without collision shapes uses its visual shapes. A missing collision mesh is replaced by the
visual one, and at last by a guessed shape, with a note.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from etude.errors import UsageError
from etude.types import Array
from etude_arm.loading.attachments import Additions, Attached, tip
from etude_arm.loading.expected import urdf_expected
from etude_arm.loading.hulls import hull, is_hull, obj_text
from etude_arm.loading.inertia import ENTRIES, masses_of
from etude_arm.loading.joint_choice import Choice, choose, example
from etude_arm.loading.loaded_model import Loaded
from etude_arm.loading.mesh_paths import MeshPaths
from etude_arm.loading.mesh_readers import read_triangles
from etude_arm.loading.parsing import body_names, free_name
from etude_arm.loading.rotations import angles_of
from etude_arm.loading.urdf_tree import (
    UrdfTree,
    axis_of,
    child,
    hard_range,
    numbers,
    parent,
    pose_of,
    read_tree,
    scale_of,
    vector,
)

COMPILER = {
    "fusestatic": "true",
    "discardvisual": "false",
    "inertiafromgeom": "false",  # otherwise MuJoCo gives a link without inertia the density of water
    "boundmass": "1e-9",
    "boundinertia": "1e-12",
}
KEPT = ("origin", "axis", "limit", "dynamics")
"""Elements of a moving joint that are kept, besides its links."""


SLENDER = 0.25
"""Radius of a guessed shape as a part of the distance to the next joint."""


@dataclass(frozen=True)
class Shapes:
    """<collision> elements by link, and their meshes. Other attributes as of `loaded_model.Loaded`."""

    elements: Mapping[str, Sequence[ET.Element]]
    assets: Mapping[str, bytes]
    notes: tuple[str, ...] = ()
    unverified: tuple[str, ...] = ()


NO_SHAPES = Shapes({}, {})


@dataclass
class _Meshes:
    """The meshes of one model file, each read once; `missing` were not found, `empty` have no triangles."""

    model: Path
    paths: MeshPaths
    assets: dict[str, bytes] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)
    empty: list[str] = field(default_factory=list)
    _read: dict[Path, Array] = field(default_factory=dict)

    def add(self, mesh: ET.Element, link: str) -> str:
        """The name of an asset with the hull of a <mesh>; "" if the file is missing or empty."""
        name = mesh.get("filename", "")
        path = self.paths.find(name)
        if path is None:
            self.missing.append(name)
            return ""
        scale = scale_of(mesh, f"{self.model}, link '{link}'")
        vertices = self._hull(path, scale)
        if not vertices:
            self.empty.append(name)
            return ""
        asset = f"{len(self.assets)}_{re.sub(r'[^A-Za-z0-9_-]', '_', link)}.obj"
        self.assets[asset] = vertices
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
        UsageError: a mesh file exists but cannot be read.
    """
    links = tree.links.values()
    named = tuple(mesh.get("filename", "") for link in links for mesh in link.iter("mesh"))
    meshes = _Meshes(path, MeshPaths(path, mesh_roots, named))
    elements: dict[str, list[ET.Element]] = {}
    notes: list[str] = []
    unverified: list[str] = []
    drawn: list[str] = []
    for cluster in tree.clusters(joints):
        solid = any(tree.links[name].find("collision") is not None for name in cluster)
        for name in cluster:
            elements[name] = _of_link(tree, name, "collision" if solid else "visual", meshes, unverified)
        shaped = [name for name in cluster if elements[name]]
        drawn += [] if solid else shaped
        unverified += [] if shaped else [f"the shape of link '{cluster[0]}': the file has none"]
    if drawn:
        notes.append(
            f"The visual geometry of {', '.join(drawn)} is used as shape, because they have no "
            "collision geometry."
        )
    notes += meshes.paths.notes
    if meshes.missing:
        names = ", ".join(map(meshes.paths.in_words, dict.fromkeys(meshes.missing)))
        notes.append(
            f"Meshes are missing: {names}. Name the folder that holds them, or their package, with "
            "--mesh-root."
        )
    if meshes.empty:
        names = ", ".join(dict.fromkeys(meshes.empty))
        notes.append(f"Meshes are empty: {names}. If the links have shapes, export the meshes again.")
    return Shapes(elements, meshes.assets, tuple(notes), tuple(unverified))


def _of_link(
    tree: UrdfTree, link: str, kind: str, meshes: _Meshes, unverified: list[str]
) -> list[ET.Element]:
    """The new <collision> elements of one link, made from its <collision> or <visual> elements."""
    elements: list[ET.Element] = []
    for shape in tree.links[link].findall(kind):
        elements += _of_shape(shape, link, meshes) or _stand_in(tree, link, kind, meshes, unverified)
    for k, element in enumerate(elements):
        element.set("name", f"{link}#{k}")
    return elements


SIZES = {
    "box": {"size": 3},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
}
"""Attributes of each shape and their number of values, m."""


def check_primitive(shape: ET.Element, place: str) -> None:
    """Raises a UsageError if the child of a <geometry> is an unknown shape or has an invalid size."""
    if shape.tag not in SIZES:
        raise UsageError(
            f"a shape <{shape.tag}> is not known",
            where=place,
            next_step=f"URDF has {', '.join(SIZES)} and mesh: correct or remove it.",
        )
    for key, count in SIZES[shape.tag].items():
        sizes = numbers(shape.get(key), "", place)
        if len(sizes) != count or not (np.all(np.isfinite(sizes)) and np.all(sizes > 0.0)):
            raise UsageError(
                f"a {shape.tag} cannot have {key}={shape.get(key)!r}",
                where=place,
                next_step=f"Give {count} number{'s' if count > 1 else ''} above zero, in m.",
            )


def _of_shape(shape: ET.Element, link: str, meshes: _Meshes) -> list[ET.Element]:
    """The new element of a shape; None if its mesh is missing or empty."""
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


def _stand_in(
    tree: UrdfTree, link: str, kind: str, meshes: _Meshes, unverified: list[str]
) -> list[ET.Element]:
    """The visual shape of a link whose collision mesh is missing or empty; else a guessed capsule to the next
    joint.
    """
    lack = _lack(tree.links[link], kind, meshes)
    if kind == "collision":
        drawn = [
            new for shape in tree.links[link].findall("visual") for new in _of_shape(shape, link, meshes)
        ]
        if drawn:
            unverified.append(f"the shape of link '{link}': {lack}, so the visual geometry is used")
            return drawn
    ends = [_offset(joint) for joint in tree.joints if parent(joint) == link]
    end = max(ends, key=lambda at: float(at @ at), default=np.zeros(3))
    if not end.any():  # the last link: the file does not state its length
        unverified.append(f"the shape of link '{link}': {lack}, and there is no replacement")
        return []
    unverified.append(f"the shape of link '{link}': {lack}, so a capsule is assumed")
    return [_capsule(end)]


def _lack(link: ET.Element, kind: str, meshes: _Meshes) -> str:
    """The reason why a link lacks a shape."""
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


PAYLOAD_SIZES = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",)}


def add_to_urdf(
    new: ET.Element, tree: UrdfTree, joints: Sequence[str], added: Additions, bodies: Mapping[str, str]
) -> dict[str, str]:
    """Adds tool and payload to the new file, whose links have the names in `bodies`; returns their names.

    Raises:
        UsageError: an unknown link, or no link is named and the arm has several ends.
    """
    taken = {*tree.links, *bodies.values()}
    if added.mounting is not None:
        room = free_name("room", taken)
        ET.SubElement(new, "link", name=room)
        at, turn = added.mounting.position, added.mounting.rotation
        _fix(new, room, bodies[tree.root], xyz=_text(at), rpy=_text(turn))
    names = {what: free_name(what, taken) for what, _ in added.carried}
    for what, one in added.carried:
        carrier = one.link or _tip_link(tree, joints, what)
        new.append(_link(names[what], one))
        _fix(new, bodies.get(carrier, carrier), names[what])
        if one.link and one.link not in tree.links:
            raise UsageError(
                f"there is no link '{one.link}'",
                where=f"[{what}]",
                next_step=f"Its links are {', '.join(tree.links)}.",
            )
    return names


def _tip_link(tree: UrdfTree, joints: Sequence[str], what: str) -> str:
    last = tip(tree.moving(), joints, what)
    return next(child(joint) for joint in tree.joints if joint.get("name") == last)


def _fix(new: ET.Element, carrier: str, link: str, **origin: str) -> None:
    taken = {one.get("name", "") for one in new.findall("joint")}
    name = free_name(f"{link} fixed to {carrier}", taken)
    joint = ET.SubElement(new, "joint", name=name, type="fixed")
    ET.SubElement(joint, "parent", link=carrier)
    ET.SubElement(joint, "child", link=link)
    if origin:
        ET.SubElement(joint, "origin", origin)


def _link(name: str, one: Attached) -> ET.Element:
    link, moments = ET.Element("link", name=name), one.moments()
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=_text(one.centre))
    ET.SubElement(inertial, "mass", value=repr(one.mass))
    ET.SubElement(inertial, "inertia", {key: repr(float(moments[i, j])) for key, i, j in ENTRIES})
    if one.shape != "none":
        collision = ET.SubElement(link, "collision", name=f"{name}#0")
        ET.SubElement(collision, "origin", xyz=_text(one.shape_centre or one.centre), rpy=_text(one.rotation))
        sizes = [_text(one.size)] if one.shape == "box" else [repr(float(value)) for value in one.size]
        ET.SubElement(
            ET.SubElement(collision, "geometry"),
            one.shape,
            dict(zip(PAYLOAD_SIZES[one.shape], sizes, strict=True)),
        )
    return link


def _text(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def load_urdf(
    root: ET.Element,
    path: Path,
    patterns: Sequence[str] | None,
    positions: Mapping[str, float],
    mesh_roots: Sequence[Path],
    with_shapes: bool,
    added: Additions,
) -> Loaded:
    """`load.load` of a parsed URDF."""
    tree = read_tree(root, str(path))
    choice = chosen_of(tree, patterns, positions)
    masses = masses_of(tree, choice.joints)
    shapes = shapes_of(tree, choice.joints, path, mesh_roots) if with_shapes else NO_SHAPES
    new = ET.Element("robot", name=root.get("name", "robot"))
    ET.SubElement(ET.SubElement(new, "mujoco"), "compiler", COMPILER)
    bodies = body_names(tree.links)
    for name in tree.links:
        written = ET.SubElement(new, "link", name=bodies[name])
        if name in masses.elements:
            written.append(masses.elements[name])
        written.extend(shapes.elements.get(name, ()))
    for joint in tree.joints:
        new.append(rewritten(joint, choice, bodies))
    carried = add_to_urdf(new, tree, choice.joints, added, bodies)
    xml = ET.tostring(new, encoding="unicode")
    notes = (*choice.notes, *masses.notes, *shapes.notes)
    unverified = (*_base(tree), *choice.unverified, *shapes.unverified, *added.unverified())
    return Loaded(
        xml,
        shapes.assets,
        choice.joints,
        choice.held,
        notes,
        unverified,
        source=str(path),
        links={body: link for link, body in bodies.items() if body != link},
        added=carried,
        expected=urdf_expected(root, choice, added),
        shapes=with_shapes,
    )


def chosen_of(tree: UrdfTree, patterns: Sequence[str] | None, positions: Mapping[str, float]) -> Choice:
    """The choice of joints in a URDF; a floating base is fixed only if the user names joints."""
    floating = tree.floating()
    if floating and patterns is None:
        raise UsageError(
            f"the base is not fixed: joint '{floating[0]}' is floating or planar",
            where=tree.where,
            next_step="Only a robot on a fixed base has an inverse dynamics here. If the base does not "
            "move, choose the arm with --joints, of "
            f"{', '.join(j.name for j in tree.moving()) or 'none'}{example(tree.moving())}.",
        )
    return choose(tree.moving(), patterns, positions, tree.where)


def _base(tree: UrdfTree) -> tuple[str, ...]:
    exception = "".join(f" although '{name}' is floating or planar" for name in tree.floating())
    return (f"the base '{tree.root}' is assumed to be fixed{exception}",)


def rewritten(joint: ET.Element, choice: Choice, bodies: Mapping[str, str]) -> ET.Element:
    """A chosen joint unchanged; any other one fixed at its held position. `bodies`: the new names of
    links.
    """
    name = joint.get("name", "")
    if name in choice.joints:
        return _moving(joint, bodies)
    fixed = _between(joint, bodies, name=name, type="fixed")
    turn, at = pose_of(joint)
    axis = axis_of(joint)
    # an axis of length zero rotates nothing, and must not be a divisor
    axis = axis / max(float(np.linalg.norm(axis)), 1e-12)
    value = choice.held.get(name, 0.0)
    if joint.get("type") == "prismatic":
        at = at + turn @ (axis * value)
    elif value:
        from etude_arm.physics.kinematics import axis_rotation

        turn = turn @ axis_rotation(axis, np.array([value]))[0]
    xyz, rpy = (" ".join(repr(float(x)) for x in three) for three in (at, angles_of(turn)))
    ET.SubElement(fixed, "origin", xyz=xyz, rpy=rpy)
    return fixed


def _between(joint: ET.Element, bodies: Mapping[str, str], **attributes: str) -> ET.Element:
    """A new joint between the same links."""
    new = ET.Element("joint", attributes)
    ET.SubElement(new, "parent", link=bodies[parent(joint)])
    ET.SubElement(new, "child", link=bodies[child(joint)])
    return new


def _moving(joint: ET.Element, bodies: Mapping[str, str]) -> ET.Element:
    """The joint with its relevant elements; a hinge without a range becomes continuous.

    MuJoCo ignores such a range too, but writes a log file into the working directory.
    """
    new = _between(joint, bodies, **joint.attrib)
    new.extend(part for part in joint if part.tag in KEPT)
    lower, upper = hard_range(joint, joint.get("name", ""))
    if joint.get("type") == "revolute" and not (lower < upper and math.isfinite(upper - lower)):
        new.set("type", "continuous")
    return new
