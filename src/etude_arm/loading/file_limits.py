"""The limits that a model file states of its joints, and those that it leaves out."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import TYPE_CHECKING

from etude.errors import UsageError
from etude.types import Array
from etude_arm.loading.urdf_checks import number
from etude_arm.loading.urdf_tree import UrdfTree, hard_range

if TYPE_CHECKING:
    import mujoco

Limits = Mapping[str, dict[str, float]]
"""Joint -> those of "lower", "upper", "velocity", "acceleration", "command" that the file states."""


def urdf_limits(tree: UrdfTree) -> Limits:
    """Of the moving joints: <limit>, within the soft limits of <safety_controller>.

    Zero velocity or effort means "not stated" in many files.
    """
    found = {}
    for joint in tree.joints:
        place = f"{tree.where}, joint '{joint.get('name')}'"
        lower, upper = _soft_range(joint, hard_range(joint, place), place)
        limit = joint.find("limit")
        stated = {} if limit is None else {key.split("}")[-1]: text for key, text in limit.attrib.items()}
        values = {name: number(stated.get(key, "0"), place) for key, name in _RATES}
        values = {name: value for name, value in values.items() if value != 0}
        if math.isfinite(upper - lower):
            values |= {"lower": lower, "upper": upper}
        found[joint.get("name", "")] = values
    return found


_RATES = (("velocity", "velocity"), ("acceleration", "acceleration"), ("effort", "command"))
"""URDF 1.2 and Drake's own attribute know accelerations."""


def _soft_range(joint: ET.Element, hard: tuple[float, float], place: str) -> tuple[float, float]:
    """The narrower of hard and soft range; a controller that states no positions narrows nothing."""
    safety = joint.find("safety_controller")
    if safety is None:
        return hard
    soft = [safety.get("soft_lower_limit"), safety.get("soft_upper_limit")]
    lower, upper = (number(text or "0", place) for text in soft)
    if None in soft or not lower < upper:
        return hard
    if not max(hard[0], lower) < min(hard[1], upper) and hard[0] < hard[1]:
        raise UsageError(
            f"the soft limits {lower:g}..{upper:g} leave nothing of the range {hard[0]:g}..{hard[1]:g}",
            where=place,
            next_step="Correct <safety_controller>, or take it out.",
        )
    return max(hard[0], lower), min(hard[1], upper)


def mjcf_limits(model: mujoco.MjModel) -> Limits:
    """Of hinges and slides: ranges, and from force ranges the command. MJCF knows no velocity limits."""
    import mujoco

    found = {}
    for j in range(model.njnt):
        if mujoco.mjtJoint(model.jnt_type[j]) in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            values: dict[str, float] = {}
            if model.jnt_limited[j]:
                values |= {"lower": float(model.jnt_range[j, 0]), "upper": float(model.jnt_range[j, 1])}
            command = _mjcf_command(model, j)
            if command < math.inf:
                values["command"] = command
            found[model.joint(j).name] = values
    return found


def _mjcf_command(model: mujoco.MjModel, joint: int) -> float:
    """Largest force at a joint that its own range or its actuator's allows; inf if neither is limited."""
    import mujoco

    if model.jnt_actfrclimited[joint]:
        return _smaller(model.jnt_actfrcrange[joint])
    for actuator in range(model.nu):
        direct = model.actuator_trntype[actuator] == int(mujoco.mjtTrn.mjTRN_JOINT)
        if direct and model.actuator_trnid[actuator, 0] == joint:
            gear = abs(float(model.actuator_gear[actuator, 0]))
            if model.actuator_forcelimited[actuator]:
                return gear * _smaller(model.actuator_forcerange[actuator])
            motor = model.actuator_biastype[actuator] == int(mujoco.mjtBias.mjBIAS_NONE)
            if model.actuator_ctrllimited[actuator] and motor:
                gain = abs(float(model.actuator_gainprm[actuator, 0]))
                return gear * gain * _smaller(model.actuator_ctrlrange[actuator])
    return math.inf


def _smaller(ends: Array) -> float:
    """What a drive gives to both sides, of a range (2,); of a range to one side alone, its end."""
    low, high = float(ends[0]), float(ends[1])
    return min(-low, high) if low < 0.0 < high else max(abs(low), abs(high))
