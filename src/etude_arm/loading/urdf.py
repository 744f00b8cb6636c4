"""A URDF, rewritten so that MuJoCo loads it: chosen joints, convex hulls, sound inertias.

MuJoCo reads URDF, but none of those that name their meshes as ROS does, and none with an inertia of zero. So
a new file is written of what matters, and nothing of the old one is patched.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from etude.errors import UsageError
from etude_arm.loading.attached import Additions
from etude_arm.loading.choice import Choice, choose
from etude_arm.loading.inertia import masses_of
from etude_arm.loading.limbs import example
from etude_arm.loading.loaded import Loaded
from etude_arm.loading.names import body_names
from etude_arm.loading.rotations import angles_of
from etude_arm.loading.urdf_additions import add_to_urdf
from etude_arm.loading.urdf_checks import axis_of
from etude_arm.loading.urdf_expected import urdf_expected
from etude_arm.loading.urdf_shapes import NO_SHAPES, shapes_of
from etude_arm.loading.urdf_tree import UrdfTree, child, hard_range, parent, pose_of, read_tree

COMPILER = {
    "fusestatic": "true",
    "discardvisual": "false",
    "inertiafromgeom": "false",  # or a link without inertia would weigh as much as water of its shape
    "boundmass": "1e-9",
    "boundinertia": "1e-12",
}
KEPT = ("origin", "axis", "limit", "dynamics")
"""Of a joint that moves, beside its ends."""


def load_urdf(
    root: ET.Element,
    path: Path,
    wanted: Sequence[str] | None,
    given: Mapping[str, float],
    mesh_roots: Sequence[Path],
    with_shapes: bool,
    added: Additions,
) -> Loaded:
    """`load.load` of a parsed URDF."""
    tree = read_tree(root, str(path))
    choice = chosen_of(tree, wanted, given)
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
    unseen = (*_base(tree), *choice.unseen, *shapes.unseen, *added.unseen())
    return Loaded(
        xml,
        shapes.assets,
        choice.joints,
        choice.held,
        notes,
        unseen,
        source=str(path),
        links={body: link for link, body in bodies.items() if body != link},
        added=carried,
        expected=urdf_expected(root, choice, added),
        shapes=with_shapes,
    )


def chosen_of(tree: UrdfTree, wanted: Sequence[str] | None, given: Mapping[str, float]) -> Choice:
    """The choice of joints in a URDF; a base that the file leaves free is fixed only if joints are named."""
    floating = tree.floating()
    if floating and wanted is None:
        raise UsageError(
            f"the base is not fixed: joint '{floating[0]}' is floating or planar",
            where=tree.where,
            next_step="Only a robot on a fixed base has an inverse dynamics here. If the base stands still, "
            f"choose the arm with --joints, of {', '.join(j.name for j in tree.moving()) or 'none'}"
            f"{example(tree.moving())}.",
        )
    return choose(tree.moving(), wanted, given, tree.where)


def _base(tree: UrdfTree) -> tuple[str, ...]:
    loose = "".join(f" although '{name}' is floating or planar" for name in tree.floating())
    return (f"the base '{tree.root}' is taken to be fixed{loose}",)


def rewritten(joint: ET.Element, choice: Choice, bodies: Mapping[str, str]) -> ET.Element:
    """A chosen joint as it is; any other one fixed where it is held. `bodies`: the new names of links."""
    name = joint.get("name", "")
    if name in choice.joints:
        return _moving(joint, bodies)
    fixed = _between(joint, bodies, name=name, type="fixed")
    turn, at = pose_of(joint)
    axis = axis_of(joint)
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
    """The joint without what does not matter; a hinge without a range turns without end.

    MuJoCo leaves such a range out too, but says so in a file that it writes wherever it runs.
    """
    new = _between(joint, bodies, **joint.attrib)
    new.extend(part for part in joint if part.tag in KEPT)
    lower, upper = hard_range(joint, joint.get("name", ""))
    if joint.get("type") == "revolute" and not (lower < upper and math.isfinite(upper - lower)):
        new.set("type", "continuous")
    return new
