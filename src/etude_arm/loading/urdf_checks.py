"""What the joints of a URDF must be before anything is made of them: of a known type, with an axis.

A joint of a type that nobody knows would else be taken for one that does not move, and its motion for none.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence

import numpy as np

from etude.errors import UsageError
from etude.types import Array

MOVING = ("revolute", "prismatic", "continuous")
FLOATING = ("floating", "planar")
TYPES = (*MOVING, "fixed", *FLOATING)


def check_joints(joints: Sequence[ET.Element], where: str) -> None:
    """Raises a UsageError that names the first joint that is none."""
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
    """Those that follow (<mimic>) follow in the end one that moves by itself."""
    for name in joints:
        seen, at = [name], name
        while (mimic := joints[at].find("mimic")) is not None:
            at = mimic.get("joint", "")
            if at not in joints or at in seen:
                gone = f"joint '{at}', which is not there" if at not in joints else "itself"
                raise UsageError(
                    f"joint '{name}' follows {gone} (<mimic>)",
                    where=where,
                    next_step="Correct <mimic>, or take it out if the joint moves by itself.",
                )
            seen.append(at)


def axis_of(joint: ET.Element, place: str = "") -> Array:
    """(3,) a joint's <axis>, of any length."""
    return vector(_attribute(joint, "axis", "xyz"), "1 0 0", place)


def _attribute(joint: ET.Element, tag: str, key: str) -> str | None:
    element = joint.find(tag)
    return None if element is None else element.get(key)


def number(text: str, place: str) -> float:
    """A number of the file; infinity is one, NaN is none."""
    try:
        value = float(text)
    except ValueError as problem:
        how = "Expand the file with xacro first." if "$" in text else "Write it like -1.5."
        raise UsageError(f"this is no number: {problem}", where=place, next_step=how) from None
    if np.isnan(value):
        raise UsageError("NaN is no number", where=place, next_step="Correct the model file.")
    return value


def numbers(text: str | None, default: str, place: str = "") -> Array:
    """The numbers of an attribute."""
    return np.array([number(word, place) for word in (text or default).split()])


def vector(text: str | None, default: str, place: str = "") -> Array:
    """(3,) finite numbers of an attribute such as xyz."""
    found = numbers(text, default, place)
    if len(found) != 3 or not np.all(np.isfinite(found)):
        raise UsageError(
            f"{text!r} should be three numbers", where=place, next_step='Write them like "0 0 0.1".'
        )
    return found


def scale_of(mesh: ET.Element, place: str) -> Array:
    """(3,) factors of a <mesh>, which may state one for all; none is 0."""
    found = numbers(mesh.get("scale"), "1 1 1", place)
    if len(found) not in (1, 3) or not (np.all(np.isfinite(found)) and found.all()):
        raise UsageError(
            f"a mesh cannot be scaled by {mesh.get('scale')!r}",
            where=place,
            next_step='Write three numbers, such as "0.001 0.001 0.001" for a mesh in mm.',
        )
    return np.broadcast_to(found, 3)
