"""A model file made to stand alone: its meshes lie beside it, and it names them there."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from collections.abc import Collection, Sequence
from pathlib import Path

from etude.errors import UsageError
from etude_arm.loading.hulls import hull, obj_text
from etude_arm.loading.loaded import refused
from etude_arm.loading.mesh_paths import MeshPaths
from etude_arm.loading.mesh_readers import read_triangles
from etude_arm.loading.parsing import parsed
from etude_arm.loading.slabs import slabs
from etude_arm.loading.urdf_checks import scale_of

MESHES = "robot_meshes"
DRAWN = (
    "Hulls that often overlap others stand for the shapes of {} in the model file: slabs of what is drawn of "
    "them, which fills these hulls, are taken instead."
)
EMPTY = b"# empty\n"
DEEPEST = 20
"""Levels of includes; more is a circle."""


def packed(
    path: Path,
    mesh_roots: Sequence[Path] = (),
    crowded: Collection[str] = (),
    notes: list[str] | None = None,
) -> tuple[bytes, dict[str, bytes]]:
    """The model file's bytes, and the mesh files that they name, by their path relative to it.

    A URDF keeps everything but its pictures; its meshes become their convex hulls, bent ones of the links in
    `crowded` several; see `slabs`. An MJCF keeps everything, includes in their places, and gets slabs beside
    the bent ones. What is missing stays missing. A file without meshes and includes is copied byte
    by byte. What a person should confirm of that is added to `notes`.

    Raises:
        UsageError: unreadable XML or mesh, a missing include, or includes in a circle.
    """
    data = path.read_bytes()
    root = parsed(path)
    if root.tag == "robot":
        meshes = _packed_urdf(root, path, mesh_roots, crowded)
        changed = bool(meshes)
    else:
        if attached := root.find(".//asset/model") is not None:
            root = _with_attached(path)
        includes = attached or root.find(".//include") is not None
        if includes:
            _expand(root, path.parent, 0)
        meshes = _packed_mjcf(root, path, crowded, [] if notes is None else notes)
        changed = includes or bool(meshes)
    return (bytes(ET.tostring(root, encoding="utf-8")) if changed else data), meshes


def _packed_urdf(
    root: ET.Element, path: Path, mesh_roots: Sequence[Path], crowded: Collection[str]
) -> dict[str, bytes]:
    """Replaces meshes by hulls; pictures stay where no collision shape does."""
    meshes: dict[str, bytes] = {}
    named = tuple(mesh.get("filename", "") for link in root.findall("link") for mesh in link.iter("mesh"))
    paths = MeshPaths(path, mesh_roots, named)
    for link in root.findall("link"):
        solid, drawn = link.findall("collision"), link.findall("visual")
        cut = link.get("name") in crowded
        kept = [_pack_shape(link, shape, paths, meshes, cut) for shape in solid]
        for picture in drawn:
            if kept and all(kept):
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
    """Gives a shape the hull of its mesh, or several of a bent one; False if it is missing or empty."""
    mesh = shape.find("geometry/mesh")
    if mesh is None:
        return True
    found = paths.find(mesh.get("filename", ""))
    if found is None:
        return False
    scale = scale_of(mesh, str(paths.model))
    mesh.attrib.pop("scale", None)
    triangles = read_triangles(found) * scale
    if not len(triangles):  # stays an empty one, so that it is not said to be missing
        name = f"{MESHES}/{len(meshes)}_{found.stem}.obj"
        meshes[name] = EMPTY
        mesh.set("filename", name)
        return False
    names = []
    for part in slabs(triangles) if cut else [triangles.reshape(-1, 3)]:
        names.append(f"{MESHES}/{len(meshes)}_{found.stem}.obj")
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
    """The file as MuJoCo writes it: with other models that it attaches, which would stay behind."""
    import mujoco

    try:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.compile()
        return ET.fromstring(spec.to_xml())
    except ValueError as problem:
        raise refused(problem, str(path)) from None


def _packed_mjcf(
    root: ET.Element, path: Path, crowded: Collection[str], notes: list[str]
) -> dict[str, bytes]:
    """Meshes under names of their own, beside the file, and slabs of bent ones."""
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
    meshes |= _slabs(root, path, crowded, notes)
    for one in root.findall("compiler") if meshes else ():
        for key in ("meshdir", "assetdir"):
            one.attrib.pop(key, None)
    return meshes


def _slabs(root: ET.Element, path: Path, crowded: Collection[str], notes: list[str]) -> dict[str, bytes]:
    if not crowded:
        return {}
    from etude_arm.loading.mjcf_compiled import compiled
    from etude_arm.loading.mjcf_slabs import Slabs

    found = Slabs(root, compiled(path).model, MESHES)
    found.add(crowded)
    notes += [DRAWN.format(", ".join(found.drawn))] if found.drawn else []
    return found.files


def _expand(element: ET.Element, folder: Path, depth: int) -> None:
    """Replaces each <include file="..."> below `element` by the children of that file's root.

    `folder` is the main file's: MuJoCo means every path from there, in included files too.
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
