"""Packing of a model file with its meshes into files that need no others.

If the collision mesh of a link is already a hull, the slabs are made from its visual mesh, provided that this
fills the hull.
"""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from etude.errors import UsageError
from etude.types import Array
from etude_arm.loading.hulls import hull, obj_text, slabs
from etude_arm.loading.loaded_model import refused
from etude_arm.loading.mesh_paths import MeshPaths
from etude_arm.loading.mesh_readers import read_triangles
from etude_arm.loading.mjcf_compiled import MESH, geoms_of
from etude_arm.loading.parsing import parsed
from etude_arm.loading.urdf_tree import scale_of

if TYPE_CHECKING:
    import mujoco

MESHES = "robot_meshes"
DRAWN = (
    "Hulls of the shapes of {} in the model file often overlap others: slabs of their visual geometry, "
    "which fill these hulls, are used instead."
)
EMPTY = b"# empty\n"
DEEPEST = 20
"""Levels of includes; more is a circle."""


def packed(
    path: Path,
    mesh_roots: Sequence[Path] = (),
    overlapping: Collection[str] = (),
    notes: list[str] | None = None,
) -> tuple[bytes, dict[str, bytes]]:
    """The model file's bytes, and the mesh files that they name, by their path relative to it.

    A URDF keeps all but its textures. Its meshes become convex hulls, and bent meshes of links in
    `overlapping` become several; see `slabs`. An MJCF keeps everything, with includes inserted, and gets
    slabs beside its bent meshes. Missing files stay missing. A file without meshes and includes is copied
    unchanged. Sentences for the user to confirm are added to `notes`.

    Raises:
        UsageError: unreadable XML or mesh, a missing include, or includes in a circle.
    """
    data = path.read_bytes()
    root = parsed(path)
    if root.tag == "robot":
        meshes = _packed_urdf(root, path, mesh_roots, overlapping)
        changed = bool(meshes)
    else:
        if attached := root.find(".//asset/model") is not None:
            root = _with_attached(path)
        includes = attached or root.find(".//include") is not None
        if includes:
            _expand(root, path.parent, 0)
        meshes = _packed_mjcf(root, path, overlapping, [] if notes is None else notes)
        changed = includes or bool(meshes)
    return (bytes(ET.tostring(root, encoding="utf-8")) if changed else data), meshes


def _packed_urdf(
    root: ET.Element, path: Path, mesh_roots: Sequence[Path], overlapping: Collection[str]
) -> dict[str, bytes]:
    """Replaces meshes by hulls; visual shapes stay where a link has no collision shape."""
    meshes: dict[str, bytes] = {}
    named = tuple(mesh.get("filename", "") for link in root.findall("link") for mesh in link.iter("mesh"))
    paths = MeshPaths(path, mesh_roots, named)
    for link in root.findall("link"):
        solid, drawn = link.findall("collision"), link.findall("visual")
        cut = link.get("name") in overlapping
        has_hull = [_pack_shape(link, shape, paths, meshes, cut) for shape in solid]
        for picture in drawn:
            if has_hull and all(has_hull):
                link.remove(picture)
            else:
                _pack_shape(link, picture, paths, meshes, False)
    return meshes


def _pack_shape(
    link: ET.Element,
    shape: ET.Element,
    paths: MeshPaths,
    meshes: dict[str, bytes],
    cut: bool,
) -> bool:
    """Gives a shape the hull of its mesh, or several for a bent mesh; returns False if the mesh is missing or
    empty.
    """
    mesh = shape.find("geometry/mesh")
    if mesh is None:
        return True
    mesh_file = paths.find(mesh.get("filename", ""))
    if mesh_file is None:
        return False
    scale = scale_of(mesh, str(paths.model))
    mesh.attrib.pop("scale", None)
    triangles = read_triangles(mesh_file) * scale
    if not len(triangles):  # stays empty, so that it is not reported as missing
        name = f"{MESHES}/{len(meshes)}_{mesh_file.stem}.obj"
        meshes[name] = EMPTY
        mesh.set("filename", name)
        return False
    names = []
    for part in slabs(triangles) if cut else [triangles.reshape(-1, 3)]:
        names.append(f"{MESHES}/{len(meshes)}_{mesh_file.stem}.obj")
        meshes[names[-1]] = obj_text(*hull(part))
    at = list(link).index(shape)
    for k, name in enumerate(names[1:], start=1):
        another = copy.deepcopy(shape)
        another.attrib.pop("name", None)
        _name_mesh(another, name)
        link.insert(at + k, another)
    mesh.set("filename", names[0])
    return True


def _name_mesh(shape: ET.Element, name: str) -> None:
    for mesh in shape.findall("geometry/mesh"):
        mesh.set("filename", name)


def _with_attached(path: Path) -> ET.Element:
    """The file as MuJoCo writes it, with the models that it attaches."""
    import mujoco

    try:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.compile()
        return ET.fromstring(spec.to_xml())
    except ValueError as problem:
        raise refused(problem, str(path)) from None


def _packed_mjcf(
    root: ET.Element, path: Path, overlapping: Collection[str], notes: list[str]
) -> dict[str, bytes]:
    """Copies meshes under unique names beside the file, and adds slabs of bent ones."""
    meshes: dict[str, bytes] = {}
    compiler = {key: value for one in root.findall("compiler") for key, value in one.attrib.items()}
    folder = path.parent / compiler.get("meshdir", compiler.get("assetdir", ""))
    elements = [mesh for mesh in root.findall("asset/mesh") if mesh.get("file")]
    for mesh in elements:
        file = folder / mesh.attrib["file"]
        mesh.set("name", mesh.get("name", file.stem))
        if not file.is_file():
            continue
        name = f"{MESHES}/{len(meshes)}_{file.name}"
        meshes[name] = file.read_bytes()
        mesh.set("file", name)
    meshes |= _slabs(root, path, overlapping, notes)
    for one in root.findall("compiler") if meshes else ():
        for key in ("meshdir", "assetdir"):
            one.attrib.pop(key, None)
    return meshes


FRAME = {"pos": "0 0 0", "quat": "1 0 0 0"}
"""Of a geom in its body."""
AS_IT_IS = {"scale": "1 1 1", "refpos": "0 0 0", "refquat": "1 0 0 0"}
"""Of a mesh, whatever the file's default is."""
FILLED = 0.005
"""m: a visual mesh fills a hull that extends beyond it by at most this length."""


@dataclass
class Slabs:
    """Additions: meshes by file name, and the links whose visual mesh was used."""

    root: ET.Element
    model: mujoco.MjModel
    folder: str
    files: dict[str, bytes] = field(default_factory=dict)
    drawn: list[str] = field(default_factory=list)

    def add(self, overlapping: Collection[str]) -> None:
        """Slabs of the bodies in `overlapping`.

        The whole mesh stays for its mass but no longer collides. A body whose geoms differ from those of the
        file (copied by <replicate>, or without their mesh) stays unchanged.
        """
        for body in [one for one in self.root.iter("body") if one.get("name") in overlapping]:
            written, name = list(_geoms(body)), body.get("name", "")
            geoms = geoms_of(self.model, self.model.body(name).id)
            if len(written) == len(geoms):
                self._body(body, name, list(zip(written, geoms, strict=True)))

    def _body(self, body: ET.Element, name: str, geoms: list[tuple[ET.Element, int]]) -> None:
        m = self.model
        meshes = [(element, g) for element, g in geoms if int(m.geom_type[g]) == MESH]
        solid = [(element, g) for element, g in meshes if m.geom_contype[g] or m.geom_conaffinity[g]]
        parts = {g: slabs(_triangles(m, g)) for _, g in solid}
        bent = [(element, g) for element, g in solid if len(parts[g]) > 1]
        if not bent and (drawn := _filling(m, [g for _, g in solid], [g for _, g in meshes])):
            self.drawn.append(name)
            bent, parts = solid, {g: drawn if g == solid[0][1] else [] for _, g in solid}
        for element, g in bent:
            for part in parts[g]:
                body.append(self._slab(element, part))
            element.attrib.update(contype="0", conaffinity="0")

    def _slab(self, like: ET.Element, points: Array) -> ET.Element:
        """A geom without mass that collides as another does."""
        file = f"{self.folder}/slab_{len(self.files)}.obj"
        self.files[file] = obj_text(*hull(points))
        ET.SubElement(ET.SubElement(self.root, "asset"), "mesh", {"name": file, "file": file, **AS_IT_IS})
        slab = copy.deepcopy(like)
        for key in [one for one in slab.attrib if one not in ("class", "contype", "conaffinity", "group")]:
            del slab.attrib[key]
        slab.attrib.update(type="mesh", mesh=file, mass="0", **FRAME)
        return slab


def _geoms(body: ET.Element) -> Iterator[ET.Element]:
    """Geoms of a body, in the order in which MuJoCo counts them."""
    for child in body:
        if child.tag == "geom":
            yield child
        elif child.tag == "frame":
            yield from _geoms(child)


def _triangles(model: mujoco.MjModel, geom: int) -> Array:
    """(n, 3, 3) of a geom's mesh, in the frame of its body."""
    import mujoco

    mesh, turn = int(model.geom_dataid[geom]), np.zeros(9)
    first, face = int(model.mesh_vertadr[mesh]), int(model.mesh_faceadr[mesh])
    points = model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])].astype(float)
    mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
    points = points @ turn.reshape(3, 3).T + model.geom_pos[geom]
    return np.asarray(points[model.mesh_face[face : face + int(model.mesh_facenum[mesh])]])


def _filling(model: mujoco.MjModel, solid: list[int], meshes: list[int]) -> list[Array]:
    """Points of the slabs of the visual mesh, if it fills the collision mesh and is bent; else none."""
    drawn = [_triangles(model, g) for g in meshes if g not in solid]
    if not solid or not drawn:
        return []
    whole = np.concatenate(drawn)
    parts, points = slabs(whole), whole.reshape(-1, 3)
    beyond = max(_beyond(_triangles(model, g).reshape(-1, 3), points) for g in solid)
    return parts if len(parts) > 1 and beyond < FILLED else []


def _beyond(points: Array, others: Array) -> float:
    """Largest distance of points (n, 3) beyond the planes of the hull of the others, m."""
    vertices, faces = hull(others)
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    return float((hull(points)[0] @ normals.T - np.einsum("fi,fi->f", a, normals)).max())


def _slabs(root: ET.Element, path: Path, overlapping: Collection[str], notes: list[str]) -> dict[str, bytes]:
    if not overlapping:
        return {}
    from etude_arm.loading.mjcf_compiled import compiled

    pieces = Slabs(root, compiled(path).model, MESHES)
    pieces.add(overlapping)
    notes += [DRAWN.format(", ".join(pieces.drawn))] if pieces.drawn else []
    return pieces.files


def _expand(element: ET.Element, folder: Path, depth: int) -> None:
    """Replaces each <include file="..."> below `element` by the children of that file's root.

    `folder` is the main file's: MuJoCo resolves every path from there, in included files too.
    """
    if depth > DEEPEST:
        raise UsageError("the model's files include each other in a circle", where=str(folder))
    children: list[ET.Element] = []
    for child in element:
        if child.tag == "include":
            included = _parse(folder / child.attrib.get("file", ""))
            _expand(included, folder, depth + 1)
            children += list(included)
        else:
            _expand(child, folder, depth)
            children.append(child)
    element[:] = children


def _parse(path: Path) -> ET.Element:
    try:
        return ET.parse(path).getroot()
    except (OSError, ET.ParseError) as error:
        raise UsageError(f"the model file cannot be read: {error}", where=str(path)) from None
