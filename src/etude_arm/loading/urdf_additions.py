"""Mounting, tool and payload as links of a URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence

from etude.errors import UsageError
from etude_arm.loading.attached import Additions, Attached, tip
from etude_arm.loading.inertia import ENTRIES
from etude_arm.loading.names import free_name
from etude_arm.loading.urdf_tree import UrdfTree, child

SIZES = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",)}


def add_to_urdf(
    new: ET.Element, tree: UrdfTree, joints: Sequence[str], added: Additions, bodies: Mapping[str, str]
) -> dict[str, str]:
    """Adds them to the new file, which calls links as `bodies` says; returns the names of tool and payload.

    Raises:
        UsageError: a link that is not there, or none is named and the arm has several ends.
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
            ET.SubElement(collision, "geometry"), one.shape, dict(zip(SIZES[one.shape], sizes, strict=True))
        )
    return link


def _text(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
