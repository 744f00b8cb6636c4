"""Model file (URDF or MJCF) as a description: joints, limits, and sentences for a person to confirm."""

from __future__ import annotations

import math
import shlex
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING

from etude.errors import UsageError
from etude.toml_tables import toml_value
from etude.types import Array
from etude_arm.description_checks import METRES, RADIANS, check_spec, suspected
from etude_arm.joint_limits import tightened
from etude_arm.loading.joint_choice import Choice, Moving
from etude_arm.loading.parsing import parsed
from etude_arm.loading.urdf_tree import UrdfTree, hard_range, number
from etude_arm.spec import ArmSpec, Axis

if TYPE_CHECKING:
    import mujoco

STOPPING_TIME = 0.5  # s: the rule for accelerations that a file does not give, velocity limit / 0.5 s
LARGEST_COMMAND = 1e6  # N m, and N: beyond any drive; files state 1e30 for "no limit"
WANTED = ("lower", "upper", "velocity", "acceleration", "command")


@dataclass(frozen=True)
class ModelDescription:
    """A robot from its model file, and sentences for a person to confirm.

    Attributes:
        spec: the robot, with every limit.
        confirm: one sentence for each limit that the file lacks, and for each joint left out.
    """

    spec: ArmSpec
    confirm: tuple[str, ...]


def spec_from_model(
    path: Path,
    *,
    name: str | None = None,
    joints: Sequence[str] | None = None,
    held: Mapping[str, float] | None = None,
    command_unit: str = "N m",
    rate: float = 100.0,
    given: Mapping[str, Mapping[str, float]] | None = None,
    joint_limits: Path | None = None,
) -> ModelDescription:
    """The robot of the joints in a URDF or MJCF file.

    Args:
        path: of the model file, which becomes the robot's `model_file`.
        name: of the robot; by default the one in the file, or the file's stem.
        joints, held: see `loading.load.load`.
        command_unit, rate: see ArmSpec; the file lacks them.
        given: joint or pattern (of moving joints; a name precedes a pattern) -> limit -> value, for limits
            that the file lacks or that replace its own. Few files give accelerations. The default is velocity
            limit / STOPPING_TIME, to be confirmed. A joint without end stops gets half a turn to either side,
            to be confirmed.
        joint_limits: MoveIt's file; its limits apply where they are tighter, see `joint_limits.tightened`.

    Raises:
        UsageError: as `load`; or an unknown joint, missing limits (all are listed), impossible limits.
    """
    root = parsed(path)
    choice, moving, stated = _read(root, path, joints, dict(held or {}))
    notes: tuple[str, ...] = ()
    if joint_limits is not None:
        stated, notes = tightened(stated, joint_limits, choice.joints, moving)
    own_limits = _by_joint(given or {}, choice.joints, list(moving), path)
    _require_within(own_limits, stated, path)
    limits = {joint: {**stated[joint], **own_limits.get(joint, {})} for joint in choice.joints}
    assumed = (*_assume_ranges(limits, moving), *_assume_accelerations(limits))
    _require_all(limits, path)
    _require_positive(limits, path)
    axes = tuple(
        _axis(joint, {limit: float(value) for limit, value in values.items()}, moving[joint].slides)
        for joint, values in limits.items()
    )
    held_joints = {joint: at for joint, at in choice.held.items() if not moving[joint].leader}
    spec = ArmSpec(
        name or _name_in(root) or path.stem, axes, command_unit, rate, path.resolve(), held=held_joints
    )
    _require_believable(spec, path)
    return ModelDescription(check_spec(spec, where=path.name), (*choice.notes, *notes, *assumed))


def _axis(joint: str, limits: dict[str, float], slides: bool) -> Axis:
    rates = limits["velocity"], limits["acceleration"]
    ends = limits["lower"], limits["upper"]
    return Axis(joint, *ends, *rates, limits["command"], "m" if slides else "rad", jerk=limits.get("jerk"))


def _name_in(root: ET.Element) -> str:
    """Name of the robot in the file; "" without one."""
    return root.get("name" if root.tag == "robot" else "model", "").strip()


Limits = Mapping[str, dict[str, float]]
"""Joint -> those of "lower", "upper", "velocity", "acceleration", "command" that the file states."""


def urdf_limits(tree: UrdfTree) -> Limits:
    """Limits of the moving joints: <limit>, within the soft limits of <safety_controller>.

    In many files, zero velocity or effort means "not stated".
    """
    limits = {}
    for joint in tree.joints:
        place = f"{tree.where}, joint '{joint.get('name')}'"
        lower, upper = _soft_range(joint, hard_range(joint, place), place)
        limit = joint.find("limit")
        stated = {} if limit is None else {key.split("}")[-1]: text for key, text in limit.attrib.items()}
        values = {name: number(stated.get(key, "0"), place) for key, name in _RATES}
        values = {name: value for name, value in values.items() if value != 0}
        if math.isfinite(upper - lower):
            values |= {"lower": lower, "upper": upper}
        limits[joint.get("name", "")] = values
    return limits


_RATES = (("velocity", "velocity"), ("acceleration", "acceleration"), ("effort", "command"))
"""URDF 1.2 and Drake's own attribute have accelerations."""


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
            f"the soft limits {lower:g}..{upper:g} do not overlap the range {hard[0]:g}..{hard[1]:g}",
            where=place,
            next_step="Correct or remove <safety_controller>.",
        )
    return max(hard[0], lower), min(hard[1], upper)


def mjcf_limits(model: mujoco.MjModel) -> Limits:
    """Limits of hinges and slides: ranges, and commands from force ranges. MJCF has no velocity limits."""
    import mujoco

    limits = {}
    for j in range(model.njnt):
        if mujoco.mjtJoint(model.jnt_type[j]) in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            values: dict[str, float] = {}
            if model.jnt_limited[j]:
                values |= {"lower": float(model.jnt_range[j, 0]), "upper": float(model.jnt_range[j, 1])}
            command = _mjcf_command(model, j)
            if command < math.inf:
                values["command"] = command
            limits[model.joint(j).name] = values
    return limits


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
    """Force of a drive in both directions, from a range (2,); for a one-sided range, its end."""
    low, high = float(ends[0]), float(ends[1])
    return min(-low, high) if low < 0.0 < high else max(abs(low), abs(high))


def _read(
    root: ET.Element, path: Path, joints: Sequence[str] | None, held: Mapping[str, float]
) -> tuple[Choice, dict[str, Moving], Limits]:
    """The choice of joints, all that move, and the limits that the file states."""
    if root.tag == "robot":
        from etude_arm.loading.urdf import chosen_of
        from etude_arm.loading.urdf_tree import read_tree

        tree = read_tree(root, str(path))
        moving_joints, limits, choice = tree.moving(), urdf_limits(tree), chosen_of(tree, joints, held)
    else:
        from etude_arm.loading.mjcf import chosen_in
        from etude_arm.loading.mjcf_compiled import compiled, moving

        model = compiled(path).model
        moving_joints, limits, choice = (
            moving(model),
            mjcf_limits(model),
            chosen_in(model, joints, held, str(path)),
        )
    return choice, {joint.name: joint for joint in moving_joints}, limits


def _by_joint(
    entries: Mapping[str, Mapping[str, float]], arm: Sequence[str], moving: Sequence[str], path: Path
) -> dict[str, dict[str, float]]:
    """The limits by joint; a name precedes a pattern. UsageError: an entry fits no joint."""
    limits: dict[str, dict[str, float]] = {}
    unknown = []
    for pattern, values in sorted(entries.items(), key=lambda entry: entry[0] in moving):
        fits = [pattern] if pattern in moving else [joint for joint in arm if fnmatchcase(joint, pattern)]
        for joint in fits:
            limits.setdefault(joint, {}).update(values)
        unknown += [] if fits else [pattern]
    if unknown:
        raise UsageError(
            f"the model has no moving joint {', '.join(unknown)}",
            where=str(path),
            next_step=f"Its moving joints are {', '.join(moving)}.",
        )
    return limits


def _require_within(overrides: Mapping[str, Mapping[str, float]], stated: Limits, path: Path) -> None:
    """Raises UsageError for a range beyond that of the file."""
    for joint, limits in overrides.items():
        low, high = stated[joint].get("lower", -math.inf), stated[joint].get("upper", math.inf)
        if limits.get("lower", low) < low or limits.get("upper", high) > high:
            raise UsageError(
                f"the range {limits.get('lower', low):g}..{limits.get('upper', high):g} of joint {joint} is "
                f"not within the file's own, {low:g}..{high:g}",
                where=str(path),
                next_step="State one inside it, or correct the file.",
            )


def _assume_ranges(limits: dict[str, dict[str, float]], moving: Mapping[str, Moving]) -> tuple[str, ...]:
    """Sets half a turn to either side for joints without end stops; one sentence for all of them."""
    endless = [joint for joint, values in limits.items() if moving[joint].endless and "lower" not in values]
    for joint in endless:
        limits[joint] = {"lower": -math.pi, "upper": math.pi, **limits[joint]}
    if not endless:
        return ()
    return (
        f"Ranges are assumed, half a turn to either side, of joints without end: "
        f"{', '.join(map(_shown, endless))}.",
    )


def _shown(joint: str) -> str:
    """A joint's name within a sentence: quoted if it has blanks or quotes of its own."""
    return joint if joint.replace("_", "").replace("-", "").isalnum() else toml_value(joint)


def _assume_accelerations(limits: Limits) -> tuple[str, ...]:
    """Sets velocity limit / STOPPING_TIME for missing accelerations; one sentence for all of them."""
    assumed = []
    for joint, values in limits.items():
        if "acceleration" not in values and values.get("velocity", 0) > 0:
            values["acceleration"] = values["velocity"] / STOPPING_TIME
            assumed.append(f"{_shown(joint)} {values['acceleration']:.4g}")
    if not assumed:
        return ()
    return (
        f"Acceleration limits are assumed, velocity limit / {STOPPING_TIME} s: {', '.join(assumed)} "
        "(rad/s^2, or m/s^2 of sliding joints).",
    )


def _require_positive(limits: Limits, path: Path) -> None:
    """Raises UsageError for a velocity or command in the file that is not positive."""
    for joint, values in limits.items():
        for limit, most in (("velocity", math.inf), ("command", LARGEST_COMMAND)):
            if not (0.0 < values[limit] <= most and math.isfinite(values[limit])):
                raise UsageError(
                    f"limit '{limit}' of joint '{joint}' must be a finite number above zero"
                    f"{'' if math.isinf(most) else f', {most:g} at most'}, not {values[limit]:g}",
                    where=str(path),
                    next_step=f"Give the one of the data sheet with --{limit} {_option(joint, '...')}.",
                )


def _require_believable(spec: ArmSpec, path: Path) -> None:
    """Raises UsageError for a limit that looks like another unit, with the option that corrects it."""
    if suspicion := suspected(spec):
        example = "lower:upper" if suspicion.option == "range" else "limit"
        units = RADIANS if suspicion.turns else METRES
        every = len(suspicion.joints) == spec.dof > 1
        arguments = " ".join(_option(joint, example) for joint in (["*"] if every else suspicion.joints))
        raise UsageError(
            suspicion.sentence,
            where=str(path),
            next_step=f"{units} Give the right one with --{suspicion.option} {arguments}, or correct the "
            "file. A robot file written by hand may say units_checked = true.",
        )


def _option(joint: str, value: str) -> str:
    """joint=value as a shell takes it."""
    return shlex.quote(f"{joint}={value}")


def _require_all(limits: Limits, path: Path) -> None:
    """Raises UsageError for missing limits; accelerations follow from velocities."""
    joints = {limit: [j for j, values in limits.items() if limit not in values] for limit in WANTED}
    lacking = {limit: names for limit, names in joints.items() if names and limit != "acceleration"}
    if lacking:
        missing = [f"{limit} of {', '.join(map(_shown, names))}" for limit, names in lacking.items()]
        options = {option: _examples(option, lacking, limits) for option in EXAMPLES}
        shown = [f"--{option} {values}" for option, values in options.items() if values]
        raise UsageError(
            f"limits are missing: {'; '.join(missing)}",
            where=str(path),
            next_step="No limit is guessed: take them from the data sheet, for each joint (wrist=...) or "
            f"for all ('*=...'), as in {' '.join(shown)}, or write the robot file by hand.",
        )


EXAMPLES = {
    "range": (("lower", "upper"), "-3:3"),
    "velocity": (("velocity",), "2.0"),
    "command": (("command",), "50"),
}
"""Option -> the limits that it gives, and an example."""


def _examples(option: str, lacking: Mapping[str, Sequence[str]], limits: Limits) -> str:
    """What the option has to say: of all joints if all lack it, else of those that do."""
    limit_names, example = EXAMPLES[option]
    joints = list(dict.fromkeys(joint for limit in limit_names for joint in lacking.get(limit, ())))
    if joints and len(joints) == len(limits):
        return _option("*", example)
    return " ".join(_option(joint, example) for joint in joints)
