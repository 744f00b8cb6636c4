"""A URDF's links and joints as a tree, with the errors that such files have."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from etude.errors import UsageError
from etude.types import Array
from etude_arm.loading.limbs import Moving
from etude_arm.loading.names import WORLD
from etude_arm.loading.rotations import turn_of
from etude_arm.loading.urdf_checks import FLOATING, MOVING, check_joints, number, vector


@dataclass(frozen=True, eq=False)
class UrdfTree:
    """Links by name and joints by the link they carry.

    Attributes:
        root: the name of the base link.
        links: their elements by name.
        joints: their elements, each after the one that carries it.
        where: the file, for messages.
    """

    root: str
    links: Mapping[str, ET.Element]
    joints: Sequence[ET.Element]
    where: str

    def moving(self) -> tuple[Moving, ...]:
        """Every hinge and slide, from the base outwards."""
        before = {self.root: ""}
        found = []
        for joint in self.joints:
            name, carrier = joint.get("name", ""), before[parent(joint)]
            moves = joint.get("type") in MOVING
            before[child(joint)] = name if moves else carrier
            if moves:
                found.append(_moving(joint, carrier, self.where))
        return tuple(found)

    def floating(self) -> list[str]:
        """Names of joints that leave a base free."""
        return [joint.get("name", "") for joint in self.joints if joint.get("type") in FLOATING]

    def clusters(self, chosen: Sequence[str]) -> list[list[str]]:
        """Links that move as one when only the chosen joints move; the base's first."""
        group = {self.root: 0}
        clusters = [[self.root]]
        for joint in self.joints:
            if joint.get("name") in chosen:
                group[child(joint)] = len(clusters)
                clusters.append([child(joint)])
            else:
                group[child(joint)] = group[parent(joint)]
                clusters[group[parent(joint)]].append(child(joint))
        return clusters


def read_tree(root: ET.Element, where: str) -> UrdfTree:
    """The tree of a <robot>.

    Raises:
        UsageError: a link that is not there, a link with two parents, several bases, joints in a circle, or
            a joint that is none (`urdf_checks`).
    """
    links = {link.get("name", ""): link for link in root.findall("link")}
    if WORLD not in links and any(parent(joint) == WORLD for joint in root.findall("joint")):
        links[WORLD] = ET.Element("link", name=WORLD)
    carried: dict[str, ET.Element] = {}
    for joint in root.findall("joint"):
        for name in (parent(joint), child(joint)):
            if name not in links:
                raise UsageError(
                    f"joint '{joint.get('name')}' names a link '{name}' that is not there",
                    where=where,
                    next_step="Name the whole robot's file if this is a part of it; else correct the joint.",
                )
        if child(joint) in carried:
            raise UsageError(
                f"link '{child(joint)}' hangs on two joints: {carried[child(joint)].get('name')}, "
                f"{joint.get('name')}",
                where=where,
                next_step="URDF knows trees only: cut the loop.",
            )
        carried[child(joint)] = joint
    bases = [name for name in links if name not in carried]
    if not links:
        raise UsageError("the file describes no link", where=where, next_step="Is it the expanded URDF?")
    if len(bases) != 1:
        raise UsageError(
            f"the file has {len(bases)} base links{': ' if bases else ''}{', '.join(bases)}",
            where=where,
            next_step="One link, and one alone, hangs on no joint.",
        )
    ordered = list(_outwards(bases[0], root.findall("joint")))
    if len(ordered) < len(carried):
        raise UsageError(
            "the joints go in a circle", where=where, next_step="URDF knows trees only: cut the loop."
        )
    check_joints(ordered, where)
    return UrdfTree(bases[0], links, ordered, where)


def _outwards(base: str, joints: Sequence[ET.Element]) -> Iterator[ET.Element]:
    """Joints depth first."""
    for joint in joints:
        if parent(joint) == base:
            yield joint
            yield from _outwards(child(joint), joints)


def parent(joint: ET.Element) -> str:
    return _link(joint, "parent")


def child(joint: ET.Element) -> str:
    return _link(joint, "child")


def _link(joint: ET.Element, tag: str) -> str:
    element = joint.find(tag)
    return "" if element is None else element.get("link", "")


def _moving(joint: ET.Element, carrier: str, where: str) -> Moving:
    name, place = joint.get("name", ""), f"{where}, joint '{joint.get('name')}'"
    lower, upper = hard_range(joint, place)
    kind, mimic = joint.get("type"), joint.find("mimic")
    own = Moving(name, carrier, lower, upper, kind == "prismatic", kind == "continuous", carries=child(joint))
    if mimic is None:
        return own
    factor, offset = (number(mimic.get(key, start), place) for key, start in _MIMIC)
    return replace(own, leader=mimic.get("joint", ""), factor=factor, offset=offset)


_MIMIC = (("multiplier", "1"), ("offset", "0"))


def hard_range(joint: ET.Element, place: str) -> tuple[float, float]:
    """The positions of a joint's <limit>; infinite if it has none, or turns without end."""
    limit = joint.find("limit")
    if limit is None or joint.get("type") == "continuous":
        return -math.inf, math.inf
    # the format's own default is 0 for both; a file that states neither, or 0 and 0, has no range
    if limit.get("lower") is None and limit.get("upper") is None:
        return -math.inf, math.inf
    lower, upper = number(limit.get("lower", "0"), place), number(limit.get("upper", "0"), place)
    return (-math.inf, math.inf) if lower == upper == 0.0 else (lower, upper)


def pose_of(element: ET.Element) -> tuple[Array, Array]:
    """(rotation (3, 3), position (3,)) of an element's <origin>; rpy turns about the fixed x, y, z."""
    origin = element.find("origin")
    attributes = {} if origin is None else origin.attrib
    roll, pitch, yaw = vector(attributes.get("rpy"), "0 0 0")
    return turn_of(roll, pitch, yaw), vector(attributes.get("xyz"), "0 0 0")
