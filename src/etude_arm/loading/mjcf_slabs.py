"""Bent links of an MJCF: hulls of slabs collide in the place of a mesh whose own hull holds much air.

Where a link collides as a hull that somebody made before, the slabs are of what is drawn of it, if that fills
the hull.
"""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from etude.types import Array
from etude_arm.loading.hulls import hull, obj_text
from etude_arm.loading.mjcf_parts import MESH, geoms_of
from etude_arm.loading.slabs import slabs

if TYPE_CHECKING:
    import mujoco

FRAME = {"pos": "0 0 0", "quat": "1 0 0 0"}
"""Of a geom in its body."""
AS_IT_IS = {"scale": "1 1 1", "refpos": "0 0 0", "refquat": "1 0 0 0"}
"""Of a mesh, whatever the file's default is."""
FILLED = 0.005
"""m: what is drawn fills a hull that reaches no farther beyond its own."""


@dataclass
class Slabs:
    """What is added: meshes by the names of their files, and the links of which what is drawn was taken."""

    root: ET.Element
    model: mujoco.MjModel
    folder: str
    files: dict[str, bytes] = field(default_factory=dict)
    drawn: list[str] = field(default_factory=list)

    def add(self, crowded: Collection[str]) -> None:
        """Slabs of the bodies in `crowded`.

        The whole mesh stays for what it weighs, and collides no more. A body whose geoms are not those of the
        file (copied by <replicate>, or without their mesh) stays as it is.
        """
        for body in [one for one in self.root.iter("body") if one.get("name") in crowded]:
            written, name = list(_geoms(body)), body.get("name", "")
            own = geoms_of(self.model, self.model.body(name).id)
            if len(written) == len(own):
                self._body(body, name, list(zip(written, own, strict=True)))

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
    """Points of the slabs of what is drawn, if it fills what collides and is bent; else nothing."""
    drawn = [_triangles(model, g) for g in meshes if g not in solid]
    if not solid or not drawn:
        return []
    whole = np.concatenate(drawn)
    parts, points = slabs(whole), whole.reshape(-1, 3)
    beyond = max(_beyond(_triangles(model, g).reshape(-1, 3), points) for g in solid)
    return parts if len(parts) > 1 and beyond < FILLED else []


def _beyond(points: Array, others: Array) -> float:
    """How far points (n, 3) reach beyond the planes of the others' hull, m."""
    vertices, faces = hull(others)
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    return float((hull(points)[0] @ normals.T - np.einsum("fi,fi->f", a, normals)).max())
