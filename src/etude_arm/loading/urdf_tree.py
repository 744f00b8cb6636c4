"""A URDF's links and joints as a tree, and the common errors of such files.

A joint of unknown type is an error: it must not count as fixed.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude.errors import UsageError
from etude.types import Array
from etude_arm.loading.joint_choice import Moving
from etude_arm.loading.parsing import WORLD
from etude_arm.loading.rotations import turn_of


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
        joints = []
        for joint in self.joints:
            name, carrier = joint.get("name", ""), before[parent(joint)]
            moves = joint.get("type") in MOVING
            before[child(joint)] = name if moves else carrier
            if moves:
                joints.append(_moving(joint, carrier, self.where))
        return tuple(joints)

    def floating(self) -> list[str]:
        """Names of joints with a floating or planar base."""
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
        UsageError: an unknown link, a link with two parents, several bases, a loop of joints, or an invalid
            joint.
    """
    links = {link.get("name", ""): link for link in root.findall("link")}
    if WORLD not in links and any(parent(joint) == WORLD for joint in root.findall("joint")):
        links[WORLD] = ET.Element("link", name=WORLD)
    carried: dict[str, ET.Element] = {}
    for joint in root.findall("joint"):
        for name in (parent(joint), child(joint)):
            if name not in links:
                raise UsageError(
                    f"joint '{joint.get('name')}' names a link '{name}' that does not exist",
                    where=where,
                    next_step="Name the whole robot's file if this is a part of it; else correct the joint.",
                )
        if child(joint) in carried:
            raise UsageError(
                f"link '{child(joint)}' is the child of two joints: {carried[child(joint)].get('name')}, "
                f"{joint.get('name')}",
                where=where,
                next_step="URDF supports only trees: cut the loop.",
            )
        carried[child(joint)] = joint
    bases = [name for name in links if name not in carried]
    if not links:
        raise UsageError(
            "the file describes no link", where=where, next_step="Perhaps the file is not the expanded URDF."
        )
    if len(bases) != 1:
        raise UsageError(
            f"the file has {len(bases)} base links{': ' if bases else ''}{', '.join(bases)}",
            where=where,
            next_step="Exactly one link must be the child of no joint.",
        )
    ordered = list(_outwards(bases[0], root.findall("joint")))
    if len(ordered) < len(carried):
        raise UsageError(
            "the joints form a circle", where=where, next_step="URDF supports only trees: cut the loop."
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
    moving_joint = Moving(
        name, carrier, lower, upper, kind == "prismatic", kind == "continuous", carries=child(joint)
    )
    if mimic is None:
        return moving_joint
    factor, offset = (number(mimic.get(key, start), place) for key, start in _MIMIC)
    return replace(moving_joint, leader=mimic.get("joint", ""), factor=factor, offset=offset)


_MIMIC = (("multiplier", "1"), ("offset", "0"))


def hard_range(joint: ET.Element, place: str) -> tuple[float, float]:
    """The positions of a joint's <limit>; infinite if it has none or is continuous."""
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


MOVING = ("revolute", "prismatic", "continuous")
FLOATING = ("floating", "planar")
TYPES = (*MOVING, "fixed", *FLOATING)


def check_joints(joints: Sequence[ET.Element], where: str) -> None:
    """Raises a UsageError that names the first invalid joint."""
    for joint in joints:
        _check_type(joint, where)
        place = f"{where}, joint '{joint.get('name')}'"
        for key in ("xyz", "rpy"):
            vector(_attribute(joint, "origin", key), "0 0 0", place)
        if joint.get("type") in MOVING and not axis_of(joint, place).any():
            raise UsageError(
                "the axis is 0 0 0", where=place, next_step='Give it a direction, such as xyz="0 0 1".'
            )
    _check_leaders({joint.get("name", ""): joint for joint in joints}, where)


def _check_type(joint: ET.Element, where: str) -> None:
    kind = joint.get("type")
    if kind not in TYPES:
        raise UsageError(
            f"joint '{joint.get('name')}' has {'no type' if kind is None else f'the type {kind!r}'}",
            where=where,
            next_step=f"URDF knows the types {', '.join(TYPES)}: correct it.",
        )


def _check_leaders(joints: Mapping[str, ET.Element], where: str) -> None:
    """Checks that each chain of followers (<mimic>) ends at an independent joint."""
    for name in joints:
        chain, at = [name], name
        while (mimic := joints[at].find("mimic")) is not None:
            at = mimic.get("joint", "")
            if at not in joints or at in chain:
                leader = f"joint '{at}', which is not there" if at not in joints else "itself"
                raise UsageError(
                    f"joint '{name}' follows {leader} (<mimic>)",
                    where=where,
                    next_step="Correct <mimic>, or remove it if the joint moves independently.",
                )
            chain.append(at)


def axis_of(joint: ET.Element, place: str = "") -> Array:
    """(3,) a joint's <axis>, of any length."""
    return vector(_attribute(joint, "axis", "xyz"), "1 0 0", place)


def _attribute(joint: ET.Element, tag: str, key: str) -> str | None:
    element = joint.find(tag)
    return None if element is None else element.get(key)


def number(text: str, place: str) -> float:
    """A number of the file; infinity is accepted, NaN is not."""
    try:
        value = float(text)
    except ValueError as problem:
        how = "Expand the file with xacro first." if "$" in text else "Write it like -1.5."
        raise UsageError(f"this is not a number: {problem}", where=place, next_step=how) from None
    if np.isnan(value):
        raise UsageError("NaN is not a number", where=place, next_step="Correct the model file.")
    return value


def numbers(text: str | None, default: str, place: str = "") -> Array:
    """The numbers of an attribute."""
    return np.array([number(word, place) for word in (text or default).split()])


def vector(text: str | None, default: str, place: str = "") -> Array:
    """(3,) finite numbers of an attribute such as xyz."""
    values = numbers(text, default, place)
    if len(values) != 3 or not np.all(np.isfinite(values)):
        raise UsageError(
            f"{text!r} should be three numbers", where=place, next_step='Write them like "0 0 0.1".'
        )
    return values


def scale_of(mesh: ET.Element, place: str) -> Array:
    """(3,) factors of a <mesh>, which may state one for all axes; 0 is refused."""
    factors = numbers(mesh.get("scale"), "1 1 1", place)
    if len(factors) not in (1, 3) or not (np.all(np.isfinite(factors)) and factors.all()):
        raise UsageError(
            f"a mesh cannot be scaled by {mesh.get('scale')!r}",
            where=place,
            next_step='Write three numbers, such as "0.001 0.001 0.001" for a mesh in mm.',
        )
    return np.broadcast_to(factors, 3)
