"""Which column of a file is which channel of which joint: matched by name, in any order.

A header is read as CHANNEL and JOINT in either order, joined by any punctuation, in any case, with an
optional unit: `q_elbow`, `elbow.position`, `position.elbow`, `/joint_states/elbow/effort`,
`Elbow Velocity [deg/s]`. Instead of the joint's name, its number is accepted (`q0` .. or `position_1` ..), in
the robot's axis order, or as the numbers at the end of the joints' names.
"""

from __future__ import annotations

import difflib
import re
from dataclasses import dataclass

from etude.errors import DataError
from etude.robots.spec import RobotSpec

CHANNELS: dict[str, tuple[str, ...]] = {
    "q_des": (
        *("q_des", "q_desired", "desired_q", "desired_position", "position_desired", "position_des"),
        *("q_ref", "position_ref", "ref_position", "q_target", "target_q", "target_position", "q_cmd"),
    ),
    "qd_des": (
        *("qd_des", "qd_desired", "dq_des", "desired_velocity", "velocity_desired", "velocity_des"),
        *("qd_ref", "velocity_ref", "qd_target", "target_qd", "target_velocity"),
    ),
    "qdd_des": (
        *("qdd_des", "ddq_des", "qdd_desired", "desired_acceleration", "acceleration_desired"),
        *("qdd_ref", "target_qdd", "target_acceleration"),
    ),
    "tau_ff": ("tau_ff", "feedforward", "effort_ff", "effort_feedforward"),
    "tau_fb": ("tau_fb", "feedback", "effort_fb", "effort_feedback"),
    "q_true": ("q_true",),
    "q": (
        *("q", "position", "positions", "pos", "angle", "joint_position", "actual_q", "q_actual"),
        *("actual_position", "measured_position", "position_measured", "q_meas", "q_measured"),
    ),
    "qd": (
        *("qd", "dq", "qdot", "velocity", "velocities", "vel", "speed", "joint_velocity", "actual_qd"),
        *("qd_actual", "actual_velocity", "measured_velocity", "qd_meas", "qd_measured"),
    ),
    "qdd": ("qdd", "ddq", "qddot", "acceleration", "acc", "joint_acceleration"),
    "tau": ("tau", "u", "command", "cmd"),
}
# Words for the learned command that only one unit of it can mean.
COMMANDS: dict[str, tuple[str, ...]] = {
    "N m": ("effort", "efforts", "torque", "torques", "actual_torque", "measured_torque", "joint_effort"),
    "N": ("force", "effort", "efforts"),
    "A": ("current", "currents", "actual_current", "motor_current", "effort", "efforts"),
    "V": ("voltage", "motor_voltage", "effort", "efforts"),
    "pwm": ("pwm", "duty", "effort", "efforts"),
}
UNITS: dict[str, float] = {
    **{"rad": 1.0, "rad/s": 1.0, "rad/s2": 1.0, "rad/s^2": 1.0, "m": 1.0, "m/s": 1.0, "m/s2": 1.0},
    **dict.fromkeys(("deg", "deg/s", "deg/s2", "deg/s^2", "°", "°/s", "degrees"), 0.017453292519943295),
    **{
        "mrad": 1e-3,
        "mm": 1e-3,
        "mm/s": 1e-3,
        "nm": 1.0,
        "n m": 1.0,
        "n*m": 1.0,
        "n.m": 1.0,
        "n": 1.0,
        "a": 1.0,
    },
    **{"v": 1.0, "pwm": 1.0, "mnm": 1e-3, "ma": 1e-3, "mv": 1e-3, "": 1.0},
}
PREFIXES = ("joint_states", "joint_state", "joint", "joints", "state", "states", "robot", "robot_state")
NUMBERED = (
    r"(?P<word>[a-z_]*?)_?(?:joint_?|j)?(?P<number>\d+)",
    r"(?:joint_?|j)(?P<number>\d+)_(?P<word>[a-z_]+)",
)
REQUIRED = ("q", "tau")


@dataclass(frozen=True)
class Column:
    """One matched column: its name in the file and the factor to SI that its unit states."""

    name: str
    factor: float
    by_number: bool


@dataclass(frozen=True)
class Matching:
    """The columns of each channel in axis order, what was ignored, and the repairs to report."""

    channels: dict[str, tuple[Column, ...]]
    ignored: tuple[str, ...]
    repairs: tuple[str, ...]


def split_unit(header: str) -> tuple[str, str]:
    """('Elbow Position', 'deg') of 'Elbow Position [deg]'; a bare number in brackets is an index, no unit."""
    found = re.search(r"\s*[\[(]([^\])]*)[\])]\s*$", header)
    if found is None or found.group(1).strip().isdigit():
        return header, ""
    return header[: found.start()], found.group(1).strip().lower()


def normal(text: str) -> str:
    """Lower case, every run of other characters than letters and digits one underscore."""
    return re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")


def match_columns(headers: list[str], spec: RobotSpec, where: str) -> Matching:
    """Finds position, command and the optional channels of every axis of `spec`.

    Raises:
        DataError: a joint has no column or two, or the numbering does not fit the robot; names the file, the
            columns, the joints expected and what to do.
    """
    words = _words(spec)
    named = _named(words, spec)
    found: dict[tuple[str, str], list[Column]] = {}
    ignored = []
    for header in headers:
        bare, unit = split_unit(header)
        meaning = _meaning(normal(bare), named, words)
        if meaning is None:
            ignored.append(header)
            continue
        if unit not in UNITS:
            raise DataError(
                f"unknown unit '{unit}'",
                where=f"{where}, column '{header}'",
                next_step="Use rad, rad/s, rad/s^2, deg, deg/s, N m, A, V or pwm.",
            )
        channel, joint, by_number = meaning
        found.setdefault((channel, joint), []).append(Column(header, UNITS[unit], by_number))
    return _collect(found, ignored, spec, where)


def _words(spec: RobotSpec) -> dict[str, str]:
    """Word -> channel, with the words that mean this robot's command."""
    channels = {**CHANNELS, "tau": (*CHANNELS["tau"], *COMMANDS[spec.command_unit])}
    return {word: channel for channel, synonyms in channels.items() for word in synonyms}


def _named(words: dict[str, str], spec: RobotSpec) -> dict[str, tuple[str, str]]:
    """Every normalised header that names a joint -> (channel, joint)."""
    named: dict[str, tuple[str, str]] = {}
    for alias, joint in _aliases(spec).items():
        for word, channel in words.items():
            named.setdefault(f"{word}_{alias}", (channel, joint))
            named.setdefault(f"{alias}_{word}", (channel, joint))
    return named


def _meaning(
    text: str, named: dict[str, tuple[str, str]], words: dict[str, str]
) -> tuple[str, str, bool] | None:
    """(channel, joint's name or number, whether by number) of a normalised header; None if it has none."""
    rests = [text, *(text.removeprefix(f"{p}_") for p in PREFIXES if text.startswith(f"{p}_"))]
    for rest in rests:
        if rest in named:
            return (*named[rest], False)
    for rest in rests:
        for pattern in NUMBERED:
            found = re.fullmatch(pattern, rest)
            if found is not None and found["word"] in words:
                return words[found["word"]], found["number"], True
    return None


def _aliases(spec: RobotSpec) -> dict[str, str]:
    """Normalised spellings of each joint: its name, and the name without a final `_joint` where unique."""
    exact = {normal(name): name for name in spec.names}
    short = [normal(name).removesuffix("_joint") for name in spec.names]
    unique = {s: name for s, name in zip(short, spec.names, strict=True) if short.count(s) == 1}
    return {**unique, **exact}


def _collect(
    found: dict[tuple[str, str], list[Column]], ignored: list[str], spec: RobotSpec, where: str
) -> Matching:
    channels: dict[str, tuple[Column, ...]] = {}
    repairs: list[str] = []
    for channel in (*REQUIRED, *(c for c in CHANNELS if c not in REQUIRED)):
        mine = {joint: columns for (c, joint), columns in found.items() if c == channel}
        numbered = {j for j, columns in mine.items() if any(c.by_number for c in columns)}
        if numbered and len(numbered) == len(mine):
            mine = _by_number(channel, mine, spec, where)
            repairs.append(
                f"Columns {', '.join(mine[n][0].name for n in spec.names)} were taken for the joints "
                f"{', '.join(spec.names)}, in this order."
            )
        columns = _one_each(channel, mine, ignored, spec, where)
        if columns is not None:
            channels[channel] = columns
    if ignored:
        repairs.append(f"Columns without a meaning here were ignored: {', '.join(ignored)}.")
    return Matching(channels, tuple(ignored), tuple(repairs))


def _by_number(
    channel: str, mine: dict[str, list[Column]], spec: RobotSpec, where: str
) -> dict[str, list[Column]]:
    own = {found.group(): name for name in spec.names if (found := re.search(r"\d+$", name))}
    if len(own) == spec.dof and set(own) == set(mine):
        return {own[number]: columns for number, columns in mine.items()}
    numbers = sorted(mine, key=int)
    first = int(numbers[0])
    if first not in (0, 1) or [int(n) for n in numbers] != list(range(first, first + spec.dof)):
        raise DataError(
            f"the columns of channel '{channel}' are numbered {', '.join(numbers)}, which are not the "
            f"{spec.dof} joints {', '.join(spec.names)}",
            where=where,
            next_step="Put the joint's name into each header, for example q_" + spec.names[0] + ".",
        )
    return {name: mine[number] for name, number in zip(spec.names, numbers, strict=True)}


def _one_each(
    channel: str, mine: dict[str, list[Column]], ignored: list[str], spec: RobotSpec, where: str
) -> tuple[Column, ...] | None:
    if not mine and channel not in REQUIRED:
        return None
    double = [[c.name for c in columns] for columns in mine.values() if len(columns) > 1]
    if double:
        raise DataError(
            f"columns {' and '.join(double[0])} mean the same thing (channel '{channel}')",
            where=where,
            next_step="Remove one of them, or rename it.",
        )
    missing = [name for name in spec.names if name not in mine]
    if missing:
        raise DataError(
            f"no column for channel '{channel}' of joint {', '.join(missing)}",
            where=where,
            next_step=_advice(channel, missing[0], ignored, spec),
        )
    return tuple(mine[name][0] for name in spec.names)


def _advice(channel: str, joint: str, ignored: list[str], spec: RobotSpec) -> str:
    near = difflib.get_close_matches(f"{channel}_{joint}", ignored, n=3, cutoff=0.5)
    known = f" Not understood: {', '.join(ignored[:12])}." if ignored else ""
    hint = f" Did you mean {' or '.join(near)}?" if near else ""
    return (
        f"Expected the joints {', '.join(spec.names)}, in headers such as {channel}_{joint}.{known}{hint} "
        "Rename the columns, or correct the joint names in the robot file."
    )
