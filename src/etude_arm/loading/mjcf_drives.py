"""The actuators of a compiled model and the tendons that they pull, as MJCF: where forces act, no more."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import mujoco

ON_JOINT, ON_TENDON = (0, 1), 3  # mjtTrn: joint, joint in parent; tendon
WRAP_JOINT, WRAP_SITE = 1, 3  # mjtWrap


def add_drives(
    model: mujoco.MjModel, joints: Sequence[str], root: ET.Element, bodies: Mapping[int, ET.Element]
) -> None:
    """Adds motors of the chosen joints, and those on tendons of chosen joints or of sites."""
    tendons, motors = ET.SubElement(root, "tendon"), ET.SubElement(root, "actuator")
    for k in range(model.nu):
        kind, target = int(model.actuator_trntype[k]), int(model.actuator_trnid[k, 0])
        gear = repr(float(model.actuator_gear[k, 0]))
        if kind in ON_JOINT and model.joint(target).name in joints:
            ET.SubElement(motors, "motor", joint=model.joint(target).name, gear=gear)
        elif kind == ON_TENDON and _tendon(model, target, joints, tendons, bodies):
            ET.SubElement(motors, "motor", tendon=f"tendon{target}", gear=gear)


def _tendon(
    model: mujoco.MjModel,
    t: int,
    joints: Sequence[str],
    tendons: ET.Element,
    bodies: Mapping[int, ET.Element],
) -> bool:
    """Writes a tendon over joints or through sites; False for one over pulleys or round geoms."""
    first = int(model.tendon_adr[t])
    wraps = range(first, first + int(model.tendon_num[t]))
    kinds, objects = {int(model.wrap_type[w]) for w in wraps}, [int(model.wrap_objid[w]) for w in wraps]
    if any(part.get("name") == f"tendon{t}" for part in tendons):
        return True
    if kinds == {WRAP_JOINT}:
        names = [model.joint(j).name for j in objects]
        if not set(names) & set(joints):
            return False
        fixed = ET.SubElement(tendons, "fixed", name=f"tendon{t}")
        for name, w in zip(names, wraps, strict=True):
            if name in joints:
                ET.SubElement(fixed, "joint", joint=name, coef=repr(float(model.wrap_prm[w])))
        return True
    if kinds != {WRAP_SITE}:
        return False
    spatial = ET.SubElement(tendons, "spatial", name=f"tendon{t}")
    for site in objects:
        body = bodies[int(model.site_bodyid[site])]
        if not any(part.get("name") == f"site{site}" for part in body.findall("site")):
            at = " ".join(repr(float(x)) for x in model.site_pos[site])
            ET.SubElement(body, "site", name=f"site{site}", pos=at)
        ET.SubElement(spatial, "site", site=f"site{site}")
    return True
