"""Description checks of a robot: every limit is present, possible, and plausible in SI units."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

from etude.errors import UsageError
from etude_arm.spec import ArmSpec, Axis

COMMAND_UNITS = ("N m", "N", "A", "V", "pwm")
LARGEST_POSITION = 4 * math.pi  # two turns either way: no arm joint, but 13 degrees and more
LARGEST_VELOCITY = 100.0  # rad/s: no arm joint, but an ordinary figure in degrees per second
LARGEST_SLIDE = 20.0  # m, and m/s: no robot's axis, but an ordinary figure in mm
METRES = "Limits of slides are in metres."
RADIANS = "Limits are in radians: multiply degrees by pi/180 (0.01745)."


def check_spec(spec: ArmSpec, *, where: str = "", units_checked: bool = False) -> ArmSpec:
    """The same spec. UsageError: names the joint and the limit.

    Args:
        spec: to be checked.
        where: its file, for messages.
        units_checked: the owner confirms the units, so that large figures are not suspected to be degrees.
    """
    if not spec.axes:
        raise UsageError("a robot needs at least one axis", where=where, next_step="Add an [[axis]] table.")
    for name, count in Counter(spec.names).items():
        if not name:
            raise UsageError("an axis has an empty name", where=where)
        if count > 1:
            raise UsageError(
                f"joint '{name}' is described {count} times",
                where=where,
                next_step="Keep one [[axis]] per joint.",
            )
    if not (math.isfinite(spec.rate) and spec.rate > 0):
        raise UsageError(f"rate must be a positive number of Hz, not {spec.rate}", where=where)
    if spec.command_unit not in COMMAND_UNITS:
        raise UsageError(
            f"unknown command_unit '{spec.command_unit}'",
            where=where,
            next_step=f"Valid units: {', '.join(COMMAND_UNITS)}.",
        )
    for axis in spec.axes:
        _check_axis(axis, where)
    for motor in spec.motors:
        if motor.name not in spec.names:
            raise UsageError(
                f"[[motor]] '{motor.name}' is not a joint of the robot",
                where=where,
                next_step=f"Its joints are {', '.join(spec.names)}.",
            )
    _check_gains(spec, where)
    suspicion = suspected(spec)
    if suspicion and not units_checked:
        units = RADIANS if suspicion.turns else METRES
        raise UsageError(
            suspicion.sentence,
            where=where,
            next_step=f"{units} If the figure is right, set units_checked = true.",
        )
    return spec


def _check_gains(spec: ArmSpec, where: str) -> None:
    if spec.gains is None:
        return
    kp = spec.gains.kp
    if len(kp) != spec.dof or not all(math.isfinite(gain) and gain > 0.0 for gain in kp):
        raise UsageError(
            f"kp = {list(kp)} must be a number above zero for each of {spec.dof} joints",
            where=f"{where} [gains]",
            next_step=f"In {spec.command_unit} per rad (m), or remove [gains]: a margin is then assumed.",
        )


def _check_axis(axis: Axis, where: str) -> None:
    place = f"{where}, joint '{axis.name}'" if where else f"joint '{axis.name}'"
    for limit in ("lower", "upper", "velocity", "acceleration", "command"):
        value = getattr(axis, limit)
        if not math.isfinite(value):
            raise UsageError(f"limit '{limit}' must be a finite number, not {value}", where=place)
        if limit in ("velocity", "acceleration", "command") and value <= 0:
            raise UsageError(f"limit '{limit}' must be above zero, not {value:g}", where=place)
    for limit in ("jerk", "torque", "torque_rate"):
        value = getattr(axis, limit)
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise UsageError(
                f"limit '{limit}' must be a finite number above zero, not {value:g}", where=place
            )
    envelope = axis.envelope
    if envelope is not None and not (
        all(map(math.isfinite, (envelope.offset, envelope.slope, envelope.lower, envelope.upper)))
        and envelope.slope > 0.0
        and envelope.lower < envelope.upper
    ):
        raise UsageError(
            f"envelope {envelope} needs finite numbers, a slope above zero, and its lower end below its "
            "upper",
            where=place,
            next_step="|qd| <= offset + sqrt(slope (end - q)): copy the four numbers of the robot's manual.",
        )
    if axis.lower >= axis.upper:
        raise UsageError(
            f"lower limit {axis.lower:g} is not below upper limit {axis.upper:g}",
            where=place,
            next_step="Swap or correct the two limits.",
        )


@dataclass(frozen=True)
class Suspected:
    """Limits that look like another unit.

    Attributes:
        joints: with such limits. turns: whether these are hinges.
        sentence: the suspicion.
        option: of `etude init` that corrects them: "range" or "velocity".
    """

    joints: tuple[str, ...]
    turns: bool
    sentence: str
    option: str


SUSPECTED = {
    ("range", True): ("position", LARGEST_POSITION, "degrees, not radians"),
    ("range", False): ("position", LARGEST_SLIDE, "mm, not m"),
    ("velocity", True): ("velocity", LARGEST_VELOCITY, "degrees/s, not rad/s, or like a placeholder"),
    ("velocity", False): ("velocity", LARGEST_SLIDE, "mm/s, not m/s, or like a placeholder"),
}
"""Option, and whether a joint turns -> the limit it gives, the most to be believed, what more is like."""


def suspected(spec: ArmSpec) -> Suspected | None:
    """The first kind of limit that looks like degrees or mm, with all its joints; None without one."""
    for (option, turns), (limit, most, units) in SUSPECTED.items():
        sizes = {axis.name: _size(axis, option) for axis in spec.axes if (axis.unit == "rad") == turns}
        large = {name: size for name, size in sizes.items() if size > most}
        if large:
            (first, size), others = next(iter(large.items())), len(large) - 1
            more = f" (and of {others} more)" if others else ""
            sentence = f"{limit} limit {size:g} of joint '{first}'{more} looks like {units}"
            return Suspected(tuple(large), turns, sentence, option)
    return None


def _size(axis: Axis, option: str) -> float:
    return axis.velocity if option == "velocity" else max(abs(axis.lower), abs(axis.upper))


def unit_suspicion(spec: ArmSpec) -> str:
    """A sentence if a limit looks like one in another unit, else an empty string."""
    suspicion = suspected(spec)
    return "" if suspicion is None else suspicion.sentence
