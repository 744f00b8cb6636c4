"""Collision shapes of a URDF's links."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from etude.robots.arm.loading.urdf_tree import UrdfTree


@dataclass(frozen=True)
class Shapes:
    """<collision> elements by link, and the meshes they name. Other attributes as of `loaded.Loaded`."""

    elements: Mapping[str, Sequence[ET.Element]]
    assets: Mapping[str, bytes] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    unseen: tuple[str, ...] = ()


def shapes_of(tree: UrdfTree, joints: Sequence[str], path: Path, mesh_roots: Sequence[Path]) -> Shapes:
    """The collision shapes of every link, named "link#k"; meshes to come."""
    elements = {}
    for name, link in tree.links.items():
        kept = [copy.deepcopy(c) for c in link.findall("collision") if c.find("geometry/mesh") is None]
        for k, collision in enumerate(kept):
            collision.set("name", f"{name}#{k}")
        elements[name] = kept
    return Shapes(elements)
