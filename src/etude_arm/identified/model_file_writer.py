"""The model file again, with other inertias: a URDF or an MJCF, everything else in it as it was."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from etude.errors import UsageError
from etude.types import Array
from etude_arm.identified.pseudo_inertia import PAIRS, inertia_of
from etude_arm.loading.inertia import ENTRIES
from etude_arm.loading.parsing import declared, parsed


@dataclass(frozen=True)
class JointTerms:
    """Of one joint, in N m (N) per rad/s^2, per rad/s, and N m (N)."""

    armature: float
    damping: float
    friction: float


def central(phi: Array) -> tuple[float, Array, Array]:
    """Mass, centre (3,) and inertia about the centre (3, 3) of [m, m c, I about the origin] (10,)."""
    mass, centre = float(phi[0]), phi[1:4] / phi[0]
    return mass, centre, inertia_of(phi) - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))


def written(path: Path, bodies: Mapping[str, Array], joints: Mapping[str, JointTerms]) -> tuple[str, bytes]:
    """Name of the new file and its bytes.

    Args:
        path: the model file.
        bodies: parameters (10,) by link or body. joints: terms by joint.
    """
    if parsed(path).tag == "robot":
        return f"{path.stem}.urdf", _urdf(path, bodies, joints)
    return f"{path.stem}.xml", _mjcf(path, bodies, joints)


def _urdf(path: Path, bodies: Mapping[str, Array], joints: Mapping[str, JointTerms]) -> bytes:
    root = ET.fromstring(
        declared(path.read_bytes()), ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))
    )
    for link in root.findall("link"):
        if link.get("name") in bodies:
            for old in link.findall("inertial"):
                link.remove(old)
            link.insert(0, _inertial(bodies[link.get("name", "")]))
    for joint in root.findall("joint"):
        if joint.get("name") in joints:
            found = joint.find("dynamics")
            element = ET.SubElement(joint, "dynamics") if found is None else found
            terms = joints[joint.get("name", "")]
            element.set("damping", repr(terms.damping))
            element.set("friction", repr(terms.friction))
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="utf-8")
    return b'<?xml version="1.0"?>\n' + text + b"\n"


def _inertial(phi: Array) -> ET.Element:
    mass, centre, inertia = central(phi)
    new = ET.Element("inertial")
    ET.SubElement(new, "origin", xyz=_text(centre), rpy="0 0 0")
    ET.SubElement(new, "mass", value=repr(mass))
    ET.SubElement(new, "inertia", {key: repr(float(inertia[i, j])) for key, i, j in ENTRIES})
    return new


def _mjcf(path: Path, bodies: Mapping[str, Array], joints: Mapping[str, JointTerms]) -> bytes:
    import mujoco

    from etude_arm.loading.mjcf_compiled import name_joints

    spec = mujoco.MjSpec.from_file(str(path))
    name_joints(spec)
    for body in spec.bodies:
        if body.name in bodies:
            body.mass, body.ipos, inertia = central(bodies[body.name])
            body.fullinertia = [inertia[i, j] for i, j in PAIRS]
            body.iquat, body.inertia = [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
            body.explicitinertial = True
    for joint in spec.joints:
        if joint.name in joints:
            terms = joints[joint.name]
            joint.armature = terms.armature
            joint.damping = _like(joint.damping, terms.damping)
            joint.frictionloss = terms.friction
    try:
        spec.compile()
        return str(spec.to_xml()).encode()
    except ValueError as problem:
        raise UsageError(
            f"MuJoCo cannot write the model anew: {str(problem).strip()}", where=str(path)
        ) from None


def _like(old: Any, value: float) -> Any:
    """One damping, or a polynomial's coefficients: MuJoCo has had both."""
    return value if np.ndim(old) == 0 else [value, *np.zeros(np.size(old) - 1)]


def _text(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
