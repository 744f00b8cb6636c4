"""Joint limits in MoveIt's joint_limits.yaml: `etude init` reads them, `etude export --to joint_limits`
writes them.

MoveIt uses a limit in the file unless its `has_..._limits` is false. Units are those of ROS (REP 103): rad
and m. The file has two levels of names, so that a full YAML reader is not needed.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from etude._runtime.options import taken
from etude.errors import UsageError
from etude.protocols import Kind
from etude.toml_tables import read_text
from etude.types import Delivered
from etude_arm.loading.joint_choice import Moving
from etude_arm.spec import ArmSpec, Axis
from etude_arm.velocity_envelope import braked_range

FILE = "joint_limits.yaml"
TABLE = "joint_limits"
KEYS = {
    "min_position": ("lower", "position"),
    "max_position": ("upper", "position"),
    "max_velocity": ("velocity", "velocity"),
    "max_acceleration": ("acceleration", "acceleration"),
    "max_jerk": ("jerk", "jerk"),
    "max_effort": ("command", "effort"),
}
"""MoveIt's name -> ours, and that of its switch `has_..._limits`."""
SCALING = ("default_velocity_scaling_factor", "default_acceleration_scaling_factor")
LINE = re.compile(r"^( *)(?:\"([^\"]*)\"|'([^']*)'|([^\s#:'\"][^:#]*?))\s*:(?:\s+(.*))?$")
SWITCH = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}
DEGREES = "!degrees"
"""A tag that descriptions of Universal Robots use."""
UNLIKELY_TIMES = 10.0
"""Times the model file's velocity limit: a degree is 57 times smaller than a radian."""
LEAST_START_S = 0.01
"""s from rest to full speed: no drive is faster, but an acceleration in degrees looks as if one were."""


@dataclass(frozen=True)
class Read:
    """Contents of a file.

    Attributes:
        limits: joint -> the limits of `KEYS` in force.
        scaling: defaults of MoveIt's planner below one, by name.
    """

    limits: Mapping[str, Mapping[str, float]]
    scaling: Mapping[str, float]


def read(path: Path) -> Read:
    """The limits of a joint_limits.yaml.

    Raises:
        UsageError: the file is missing, has no `joint_limits`, or a line has another format.
    """
    levels = _levels(path)
    matches = [table for name, table in _tables(levels) if name == TABLE]
    if not matches:
        raise UsageError(
            f"there is no {TABLE}: in this file",
            where=str(path),
            next_step=f"Name MoveIt's {FILE}: {TABLE}:, below it each joint, below that max_velocity: ...",
        )
    limits = {
        joint: _limits(entries, joint, path)
        for joint, entries in matches[0].items()
        if isinstance(entries, dict)
    }
    around = {name: value for _, table in (("", levels), *_tables(levels)) for name, value in table.items()}
    scaling = {name: _number(around[name], name, path) for name in SCALING if name in around}
    return Read(limits, {name: value for name, value in scaling.items() if value < 1.0})


def _levels(path: Path) -> dict[str, Any]:
    """Nested names with texts."""
    top: dict[str, Any] = {}
    stack: list[tuple[int, dict[str, Any]]] = [(-1, top)]
    for count, line in enumerate(read_text(path, FILE).splitlines(), 1):
        text = re.sub(r"(^|\s)#.*$", "", line).rstrip()
        if not text.strip() or text in ("---", "..."):
            continue
        match = LINE.match(text)
        value = match[5].strip() if match and match[5] else ""
        if match is None or value[:1] in ("{", "[", "&", "*", "|", ">"):
            raise UsageError(
                f"line {count} is not `name: value` with leading spaces: {text.strip()!r}",
                where=str(path),
                next_step="Write one limit on each line, as MoveIt's Setup Assistant does.",
            )
        while stack[-1][0] >= len(match[1]):
            stack.pop()
        name = next(group for group in match.groups()[1:4] if group is not None)
        inner: dict[str, Any] = {}
        stack[-1][1][name] = value or inner
        if not value:
            stack.append((len(match[1]), inner))
    return top


def _tables(table: Mapping[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """All tables by name, outer ones first."""
    for name, value in table.items():
        if isinstance(value, dict):
            yield name, value
            yield from _tables(value)


def _limits(entries: Mapping[str, Any], joint: str, path: Path) -> dict[str, float]:
    limits = {}
    for key, (limit, switch) in KEYS.items():
        off = not SWITCH.get(str(entries.get(f"has_{switch}_limits", "true")).lower(), True)
        if key not in entries or off:
            continue
        value = limits[limit] = _number(entries[key], f"{key} of {joint}", path)
        if switch != "position" and not value > 0.0:
            raise UsageError(
                f"{key} of joint '{joint}' must be above zero, not {value:g}",
                where=str(path),
                next_step=f"Correct it, or write has_{switch}_limits: false.",
            )
    return limits


def _number(text: Any, what: str, path: Path) -> float:
    tag, _, digits = str(text).rpartition(" ")
    try:
        value = float(digits)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or tag.strip() not in ("", DEGREES, "!radians"):
        raise UsageError(f"{what} is not a number: {text}", where=str(path), next_step="Correct the file.")
    return math.radians(value) if tag.strip() == DEGREES else value


def tightened(
    stated: Mapping[str, Mapping[str, float]],
    path: Path,
    arm: Sequence[str],
    moving: Mapping[str, Moving],
) -> tuple[dict[str, dict[str, float]], tuple[str, ...]]:
    """A model file's limits, with the limits of a joint_limits.yaml that are tighter or missing.

    Args:
        stated: joint -> limit -> value, of the model file.
        path: of joint_limits.yaml.
        arm: learned joints. moving: all moving joints, by name.

    Returns:
        the limits, and sentences on what is ignored or missing.

    Raises:
        UsageError: as `read`; the model lacks a joint; a limit looks like degrees or mm.
    """
    moveit = read(path)
    _require_known(moveit, arm, moving, path)
    limits = {joint: dict(values) for joint, values in stated.items()}
    looser: list[str] = []
    for joint in (name for name in arm if name in moveit.limits):
        values, before = moveit.limits[joint], stated[joint]
        for limit, value in values.items():
            if limit == "velocity":
                _require_alike(value, before.get(limit), joint, moving[joint], path)
            tight = max if limit == "lower" else min
            limits[joint][limit] = tight(value, before.get(limit, value))
            if limits[joint][limit] != value:
                looser.append(f"{limit} of {joint} {value:g} for {before[limit]:g}")
        fastest = max(
            (values["velocity"] for values in (values, before) if "velocity" in values), default=math.inf
        )
        _require_possible(limits[joint], fastest, joint, moving[joint], path)
    return limits, _sentences(moveit, looser, [name for name in arm if name not in moveit.limits])


def _require_known(moveit: Read, arm: Sequence[str], moving: Mapping[str, Moving], path: Path) -> None:
    unknown = [joint for joint in moveit.limits if joint not in moving]
    if unknown or not any(joint in moveit.limits for joint in arm):
        what = f"the model has no moving joint {', '.join(unknown)}" if unknown else "it limits no joint"
        raise UsageError(
            what,
            where=str(path),
            next_step=f"Names must be those of the model file: {', '.join(moving)}. Correct the file.",
        )


def _require_alike(value: float, model: float | None, joint: str, kind: Moving, path: Path) -> None:
    """Raises UsageError for a velocity far above the model file's."""
    if model is not None and model > 0.0 and value > UNLIKELY_TIMES * model:
        units = "mm/s, not m/s" if kind.slides else "degrees/s, not rad/s"
        raise UsageError(
            f"max_velocity {value:g} of joint '{joint}' looks like {units}: the model file states {model:g}",
            where=str(path),
            next_step="Correct one of the two files.",
        )


def _require_possible(
    limits: Mapping[str, float], fastest: float, joint: str, kind: Moving, path: Path
) -> None:
    """Raises UsageError for an empty range, or an acceleration beyond any drive."""
    if limits.get("lower", -math.inf) >= limits.get("upper", math.inf):
        raise UsageError(
            f"positions {limits['lower']:g}..{limits['upper']:g} do not overlap the range of joint '{joint}'",
            where=str(path),
            next_step="Correct min_position and max_position.",
        )
    acceleration = limits.get("acceleration", 0.0)
    if acceleration * LEAST_START_S > fastest:
        units = "mm/s^2, not m/s^2" if kind.slides else "degrees/s^2, not rad/s^2"
        raise UsageError(
            f"max_acceleration {acceleration:g} of joint '{joint}' looks like {units}: the velocity limit "
            f"{fastest:g} is reached in {1e3 * fastest / acceleration:.2g} ms",
            where=str(path),
            next_step="Correct the file.",
        )


def _sentences(moveit: Read, looser: Sequence[str], missing: Sequence[str]) -> tuple[str, ...]:
    lines = []
    if looser:
        lines.append(f"The model file's limits are used where {FILE} is looser: {', '.join(looser)}.")
    if missing:
        lines.append(f"{FILE} does not name {', '.join(missing)}: the model file's limits are used.")
    for name, value in moveit.scaling.items():
        lines.append(
            f"{name} {value:g} of {FILE} does not lower limits here, because it is only the default of "
            "MoveIt's planner."
        )
    return tuple(lines)


@dataclass(frozen=True)
class JointLimitsOptions:
    """Options of every target."""

    model_hash: str = ""


class JointLimits:
    """A target (`protocols.Target`): the limits with which this campaign's motions are certified."""

    def __call__(self, model: Any, kind: Kind, spec: Any, options: Mapping[str, Any]) -> Delivered:  # noqa: ARG002
        """joint_limits.yaml. UsageError: the robot has no joints, or an option is unknown."""
        taken(options, JointLimitsOptions, TABLE)
        if not isinstance(spec, ArmSpec):
            raise UsageError(
                f"'{spec.name}' has no joints to limit", next_step="Export the model itself: --to c."
            )
        sentences = [f"{FILE} limits {spec.dof} joints as this campaign certifies motions, without margins."]
        sentences += [f"{axis.name}: {_shortened(axis)}." for axis in spec.axes if axis.envelope is not None]
        open_points = [line for line in spec.confirm if line.startswith("Acceleration limits are assumed")]
        return Delivered({FILE: written(spec).encode()}, (*sentences, *open_points))


def written(spec: ArmSpec) -> str:
    """The text of joint_limits.yaml, which `read` reads; MoveIt has no velocity envelope.

    Raises:
        UsageError: an envelope leaves no positions for the other limits.
    """
    head = [
        "# Limits that Etude certifies motions within. Units: rad, m, s; N m or N.",
        f"{TABLE}:",
    ]
    return "\n".join([*head, *(line for axis in spec.axes for line in _lines(axis))]) + "\n"


def _lines(axis: Axis) -> list[str]:
    lower, upper = braked_range(axis)
    if not lower < upper:
        raise UsageError(
            f"no position of joint '{axis.name}' keeps its envelope at {axis.velocity:g} {axis.unit}/s and "
            f"{axis.acceleration:g} {axis.unit}/s^2",
            next_step="Lower velocity or acceleration of this [[axis]] in robot.toml.",
        )
    braked = replace(axis, lower=lower, upper=upper)
    lines = [f"  {_name(axis.name)}:"]
    if axis.envelope is not None:
        lines.append(f"    # {_shortened(axis)}")
    for key, (limit, switch) in KEYS.items():
        value = None if limit == "command" else getattr(braked, limit)
        if key != "max_position" and limit != "command":
            lines.append(f"    has_{switch}_limits: {'false' if value is None else 'true'}")
        if value is not None:
            lines.append(f"    {key}: {float(value)!r}")
    return lines


def _shortened(axis: Axis) -> str:
    """Comment on the limits that replace the axis's envelope."""
    lower, upper = braked_range(axis)
    return (
        f"positions {lower:.5g} to {upper:.5g} {axis.unit} of {axis.lower:.5g} to {axis.upper:.5g}: there "
        "these limits of velocity and acceleration keep the velocity envelope"
    )


def _name(joint: str) -> str:
    """Quoted unless every reader takes it for a word."""
    return joint if re.fullmatch(r"[A-Za-z]\w*", joint) and joint.lower() not in SWITCH else json.dumps(joint)


JOINT_LIMITS = JointLimits()
