"""A robot's description from its URDF or MJCF: joints and limits, and what a person should confirm."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from etude.errors import UsageError
from etude.robots.arm.checks import check_spec
from etude.robots.arm.model_file import compile_model, parsed
from etude.robots.arm.spec import ArmSpec, Axis
from etude.robots.toml import toml_value

if TYPE_CHECKING:
    import mujoco

STOPPING_TIME = 0.5  # s: the rule for accelerations that a file does not give, velocity limit / 0.5 s
MOVING = ("revolute", "prismatic", "continuous")


@dataclass(frozen=True)
class ModelDescription:
    """A robot read from its model file, and what a person should confirm of it.

    Attributes:
        spec: the robot, with every limit.
        confirm: one sentence for each limit that the file does not state, and for each joint left out.
    """

    spec: ArmSpec
    confirm: tuple[str, ...]


def spec_from_model(
    path: Path,
    *,
    name: str | None = None,
    joints: tuple[str, ...] | None = None,
    command_unit: str = "N m",
    rate: float = 100.0,
    given: Mapping[str, Mapping[str, float]] | None = None,
) -> ModelDescription:
    """A ArmSpec from the joints of a URDF or MJCF file.

    Args:
        path: the model file; it becomes the robot's `model_file`.
        name: the robot's name; the file's stem by default.
        joints: the actuated joints, in order; by default every moving joint that mimics no other.
        command_unit, rate: not in the file; see ArmSpec.
        given: joint -> limit -> value, for limits that the file lacks or that should replace its own. Neither
            format knows accelerations: those not given are velocity limit / STOPPING_TIME, to be confirmed.

    Raises:
        UsageError: unreadable file, unknown joint, missing limits (all are listed), impossible limits.
    """
    root = parsed(path)
    found = _urdf_limits(root) if root.tag == "robot" else _mjcf_limits(path)
    chosen = joints if joints is not None else tuple(found)
    unknown = [joint for joint in [*chosen, *(given or {})] if joint not in found]
    if unknown:
        raise UsageError(
            f"the model has no moving joint {', '.join(unknown)}",
            where=str(path),
            next_step=f"Its moving joints are {', '.join(found)}.",
        )
    limits = {joint: {**found[joint], **(given or {}).get(joint, {})} for joint in chosen}
    confirm = [f"Joint {toml_value(joint)} is left out." for joint in found if joint not in chosen]
    for joint, values in limits.items():
        if "acceleration" not in values and values.get("velocity", 0) > 0:
            values["acceleration"] = values["velocity"] / STOPPING_TIME
            confirm.append(
                f"Acceleration limit {values['acceleration']:.4g} of joint {toml_value(joint)} is its "
                f"velocity limit / {STOPPING_TIME} s: confirm or correct it."
            )
    _require_all(limits, path)
    sliding = _sliding(root, path)
    axes = tuple(
        Axis(
            joint, **{limit: float(v) for limit, v in values.items()}, unit="m" if joint in sliding else "rad"
        )
        for joint, values in limits.items()
    )
    spec = ArmSpec(name or path.stem, axes, command_unit, rate, path.resolve())
    return ModelDescription(check_spec(spec, where=path.name), tuple(confirm))


def _sliding(root: ET.Element, path: Path) -> set[str]:
    """Names of the joints whose position is a length."""
    if root.tag == "robot":
        return {joint.get("name", "") for joint in root.findall("joint") if joint.get("type") == "prismatic"}
    import mujoco

    model = compile_model(path)
    slide = mujoco.mjtJoint.mjJNT_SLIDE
    return {model.joint(i).name for i in range(model.njnt) if mujoco.mjtJoint(model.jnt_type[i]) == slide}


def _require_all(limits: dict[str, dict[str, float]], path: Path) -> None:
    wanted = ("lower", "upper", "velocity", "acceleration", "command")
    missing = {joint: [limit for limit in wanted if limit not in values] for joint, values in limits.items()}
    lacking = [f"{joint} ({', '.join(which)})" for joint, which in missing.items() if which]
    if lacking:
        raise UsageError(
            f"limits are missing for {'; '.join(lacking)}",
            where=str(path),
            next_step="No limit is guessed: add them to the model file, or write the robot file by hand.",
        )


def _urdf_limits(root: ET.Element) -> dict[str, dict[str, float]]:
    """Joint -> the limits its <limit> states; zero velocity or effort means "not stated" in many files."""
    found: dict[str, dict[str, float]] = {}
    for joint in root.findall("joint"):
        if joint.get("type") not in MOVING or joint.find("mimic") is not None:
            continue
        limit = joint.find("limit")
        values = {} if limit is None else _floats(limit, joint.get("name", ""))
        if joint.get("type") == "continuous":
            values = {k: v for k, v in values.items() if k not in ("lower", "upper")}
        names = {"lower": "lower", "upper": "upper", "velocity": "velocity", "effort": "command"}
        found[joint.get("name", "")] = {
            names[k]: v
            for k, v in values.items()
            if k in names and not (k in ("velocity", "effort") and v == 0)
        }
    return found


def _floats(limit: ET.Element, joint: str) -> dict[str, float]:
    try:
        return {key: float(value) for key, value in limit.attrib.items()}
    except ValueError as problem:
        raise UsageError(f"a limit is no number: {problem}", where=f"joint '{joint}'") from None


def _mjcf_limits(path: Path) -> dict[str, dict[str, float]]:
    """Joint -> position range and, from force ranges, the command limit. MJCF has no velocity limits."""
    import mujoco

    model = compile_model(path)
    found: dict[str, dict[str, float]] = {}
    for i in range(model.njnt):
        if mujoco.mjtJoint(model.jnt_type[i]) not in (
            mujoco.mjtJoint.mjJNT_HINGE,
            mujoco.mjtJoint.mjJNT_SLIDE,
        ):
            continue
        values: dict[str, float] = {}
        if model.jnt_limited[i]:
            values |= {"lower": float(model.jnt_range[i, 0]), "upper": float(model.jnt_range[i, 1])}
        command = _mjcf_command(model, i)
        if command < math.inf:
            values["command"] = command
        found[model.joint(i).name] = values
    return found


def _mjcf_command(model: mujoco.MjModel, joint: int) -> float:
    """Largest force at a joint that its own range or its actuator's allows; inf if neither is limited."""
    import mujoco

    if model.jnt_actfrclimited[joint]:
        return float(abs(model.jnt_actfrcrange[joint]).max())
    for actuator in range(model.nu):
        direct = model.actuator_trntype[actuator] == int(mujoco.mjtTrn.mjTRN_JOINT)
        if direct and model.actuator_trnid[actuator, 0] == joint:
            gear = abs(float(model.actuator_gear[actuator, 0]))
            if model.actuator_forcelimited[actuator]:
                return gear * float(abs(model.actuator_forcerange[actuator]).max())
            motor = model.actuator_biastype[actuator] == int(mujoco.mjtBias.mjBIAS_NONE)
            if model.actuator_ctrllimited[actuator] and motor:
                gain = abs(float(model.actuator_gainprm[actuator, 0]))
                return gear * gain * float(abs(model.actuator_ctrlrange[actuator]).max())
    return math.inf
