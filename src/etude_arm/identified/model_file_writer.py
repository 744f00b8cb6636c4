"""Writer of a model file with identified inertias: otherwise unchanged, or as MJCF."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from etude.errors import UsageError
from etude.types import Array
from etude_arm.identified.pseudo_inertia import PAIRS, inertia_of
from etude_arm.loading.attachments import tip
from etude_arm.loading.inertia import ENTRIES
from etude_arm.loading.load import load_arm
from etude_arm.loading.parsing import WORLD, declared, parsed
from etude_arm.spec import ArmSpec

FUSED, APART = 'fusestatic="true"', 'fusestatic="false"'
"""MJCF attributes that merge links of one rigid part into one body, or keep them separate."""


DRIVES = "drives"
"""Name of the file with the drives' own terms, and of its default class."""
BRISTLE = 1e-3
"""rad (m): presliding distance, LuGre's deflection: logs cannot resolve less."""
FALLEN = 1e-4
"""Part of stiction that remains at speed: MuJoCo requires a positive value."""
NOTHING_ELSE = {"gear": "1", "armature": "0", "damping": "0", "nsample": "0", "delay": "0"} | {
    "forcelimited": "false",
    "forcerange": "0 0",
}
"""Attributes of an actuator that override the file's defaults."""


@dataclass(frozen=True)
class Dip:
    """Friction d v + [c + s exp(-(v / v_s)^2)] sign(v) of one joint: d, c, s, v_s, as of `JointTerms`."""

    damping: float
    friction: float
    stribeck: float
    speed: float


@dataclass(frozen=True)
class JointTerms:
    """Of one joint, in N m (N) per rad/s^2, per rad/s, and N m (N).

    Attributes:
        cogging: periods a turn, amplitude and phase of waves; the joint is driven by their sum.
        dip: the friction law that damping and friction approximate; None: they are exact.
        fastest: rad/s (m/s), largest speed of the logs that friction and damping fit.
    """

    armature: float
    damping: float
    friction: float
    cogging: tuple[tuple[int, float, float], ...] = ()
    dip: Dip | None = None
    fastest: float = math.inf


def central(phi: Array) -> tuple[float, Array, Array]:
    """Mass, centre (3,) and inertia about the centre (3, 3) of [m, m c, I about the origin] (10,)."""
    mass, centre = float(phi[0]), phi[1:4] / phi[0]
    return mass, centre, inertia_of(phi) - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))


def written(spec: ArmSpec, bodies: Mapping[str, Array], joints: Mapping[str, JointTerms]) -> dict[str, bytes]:
    """The model file in its own format, by name.

    Args:
        spec: the robot; it has a model file.
        bodies: parameters (10,) by link or body. joints: terms by joint.
    """
    assert spec.model_file is not None
    if parsed(spec.model_file).tag == "robot":
        return {f"{spec.model_file.stem}.urdf": _urdf(spec.model_file, bodies, joints)}
    return mjcf(spec, bodies, joints)


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
            existing = joint.find("dynamics")
            element = ET.SubElement(joint, "dynamics") if existing is None else existing
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


def mjcf(spec: ArmSpec, bodies: Mapping[str, Array], joints: Mapping[str, JointTerms]) -> dict[str, bytes]:
    """MJCF files and their meshes, by name: all of an MJCF; of a URDF the chosen joints with hulls and a
    motor each. Tool and payload are separate bodies. Arguments as of `written`.

    The first file has no cogging and no Stribeck dip, since older versions of MuJoCo have no such actuator.
    The second has them, if there are any.
    """
    assert spec.model_file is not None
    model, files = _of_urdf(spec) if parsed(spec.model_file).tag == "robot" else _of_mjcf(spec)
    _add_carried(model, spec, bodies)
    for body in model.bodies:
        if body.name in bodies:
            _set_inertia(body, bodies[body.name])
    for joint in model.joints:
        if joint.name in joints:
            terms = joints[joint.name]
            joint.armature = terms.armature
            joint.damping = _like(joint.damping, terms.damping)
            joint.frictionloss = terms.friction
    try:
        model.compile()
        name, text = f"{spec.model_file.stem}.xml", str(model.to_xml())
        return {name: text.encode(), **_with_drives(name, text, joints), **files}
    except ValueError as problem:
        raise UsageError(
            f"MuJoCo cannot write the model: {str(problem).strip()}", where=str(spec.model_file)
        ) from None


def with_drives(name: str) -> str:
    """Name of the second file, derived from the first."""
    return f"{name.removesuffix('.xml')}_{DRIVES}.xml"


def _with_drives(name: str, text: str, joints: Mapping[str, JointTerms]) -> dict[str, bytes]:
    """The file with an actuator without input for each wave of cogging and each dip; None without any."""
    root = ET.fromstring(text)
    default = ET.SubElement(ET.SubElement(root, "default"), "default", {"class": DRIVES})
    ET.SubElement(default, "general", NOTHING_ELSE)
    actuators = ET.SubElement(root, "actuator")

    def add(joint: str, what: str, **terms: str) -> None:
        # a motor constant of 0 gives no other force; MuJoCo requires a resistance
        still = {"class": DRIVES, "input": "none", "motorconst": "0 0", "resistance": "1"}
        ET.SubElement(actuators, "dcmotor", {"name": f"{joint} {what}", "joint": joint} | still | terms)

    for element in (one for world in root.findall("worldbody") for one in world.iter("joint")):
        terms = joints.get(joint := element.get("name", ""), JointTerms(0.0, 0.0, 0.0))
        for periods, size, phase in terms.cogging:
            add(joint, f"cogging {periods}", cogging=_text((size, periods, phase)))
        if (dip := terms.dip) is not None:
            element.set("damping", repr(dip.damping))
            element.set("frictionloss", repr(dip.friction))
            law = dip.stribeck / BRISTLE, 0.0, FALLEN * dip.stribeck, dip.stribeck, dip.speed
            add(joint, "stiction", lugre=_text(law))
    ET.indent(root)
    return {with_drives(name): ET.tostring(root) + b"\n"} if len(actuators) else {}


def _of_mjcf(spec: ArmSpec) -> tuple[Any, dict[str, bytes]]:
    """The file with gravity by the robot's mounting, and the files that it names."""
    import mujoco

    from etude_arm.loading.mjcf_compiled import name_joints

    assert spec.model_file is not None
    model = mujoco.MjSpec.from_file(str(spec.model_file))
    name_joints(model)
    if spec.mounting is not None:
        model.option.gravity = spec.mounting.turn.T @ model.option.gravity
    named = {f"{model.meshdir}/{one.file}".lstrip("/") for one in (*model.meshes, *model.skins) if one.file}
    named |= {f"{model.texturedir}/{one.file}".lstrip("/") for one in model.textures if one.file}
    paths = {name: spec.model_file.parent / name for name in sorted(named)}
    return model, {name: path.read_bytes() for name, path in paths.items() if path.is_file()}


def _of_urdf(spec: ArmSpec) -> tuple[Any, dict[str, bytes]]:
    """Makes every link a separate body, with a motor for each axis, or a servo if its gain is known."""
    import mujoco

    loaded = load_arm(spec)
    model = mujoco.MjSpec.from_string(loaded.xml.replace(FUSED, APART), assets=dict(loaded.assets))
    model.modelname = spec.name
    for body in model.bodies:
        link = loaded.links.get(body.name, body.name)
        body.name = body.name if link == WORLD else link  # MuJoCo's default
    for j, axis in enumerate(spec.axes):
        actuator = model.add_actuator(name=axis.name, target=axis.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.forcelimited, actuator.forcerange = 1, [-axis.command, axis.command]
        if spec.gains is None:
            actuator.set_to_motor()
            actuator.ctrllimited, actuator.ctrlrange = 1, [-axis.command, axis.command]
        else:
            actuator.set_to_position(kp=spec.gains.kp[j])
            actuator.ctrllimited, actuator.ctrlrange = 1, [axis.lower, axis.upper]
    return model, dict(loaded.assets)


def _add_carried(model: Any, spec: ArmSpec, bodies: Mapping[str, Array]) -> None:
    """Adds bodies for tool and payload, if the model has none."""
    from etude_arm.loading.mjcf_compiled import moving

    for what, one in (("tool", spec.tool), ("payload", spec.payload)):
        names = {body.name for body in model.bodies}
        if one is None or what not in bodies or what in names:
            continue
        link = model.body(one.link) if one.link else None
        carrier = link or model.joint(tip(moving(model.compile()), spec.names, what)).parent
        _set_inertia(carrier.add_body(name=what), bodies[what])


def _set_inertia(body: Any, phi: Array) -> None:
    body.mass, body.ipos, inertia = central(phi)
    body.fullinertia = [inertia[i, j] for i, j in PAIRS]
    body.iquat, body.inertia = [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
    body.explicitinertial = True


def _like(old: Any, value: float) -> Any:
    """Damping as a number, or as coefficients of a polynomial, which newer versions of MuJoCo use."""
    return value if np.ndim(old) == 0 else [value, *np.zeros(np.size(old) - 1)]


def _text(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
