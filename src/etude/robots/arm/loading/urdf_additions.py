"""Mounting, tool and payload as links of a URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence

from etude.errors import UsageError
from etude.robots.arm.loading.attached import Additions, Attached, free_name, tip
from etude.robots.arm.loading.inertia import ENTRIES
from etude.robots.arm.loading.urdf_tree import UrdfTree, child

SIZES = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",)}


def add_to_urdf(new: ET.Element, tree: UrdfTree, joints: Sequence[str], added: Additions) -> None:
    """Adds them to the new file.

    Raises:
        UsageError: a link that is not there, or none is named and the arm has several ends.
    """
    if added.mounting is not None:
        ET.SubElement(new, "link", name=free_name("room", tree.links))
        at, turn = added.mounting.position, added.mounting.rotation
        _fix(new, free_name("room", tree.links), tree.root, xyz=_text(at), rpy=_text(turn))
    for what, one in added.carried:
        name = free_name(what, tree.links)
        new.append(_link(name, one))
        _fix(new, one.link or _tip_link(tree, joints, what), name)
        if one.link and one.link not in tree.links:
            raise UsageError(
                f"there is no link '{one.link}'",
                where=f"[{what}]",
                next_step=f"Its links are {', '.join(tree.links)}.",
            )


def _tip_link(tree: UrdfTree, joints: Sequence[str], what: str) -> str:
    last = tip(tree.moving(), joints, what)
    return next(child(joint) for joint in tree.joints if joint.get("name") == last)


def _fix(new: ET.Element, carrier: str, link: str, **origin: str) -> None:
    joint = ET.SubElement(new, "joint", name=f"{link} fixed to {carrier}", type="fixed")
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
            ET.SubElement(collision, "geometry"), one.shape, dict(zip(SIZES[one.shape], sizes, strict=True))
        )
    return link


def _text(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
