"""How headers are read, as rows of data: words for channels, units, and words for time."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

GRAVITY = 9.81
"""m/s^2."""
DESIRED = ("des", "desired", "ref", "reference", "target", "setpoint", "goal")
"""Words that say of a quantity that it is asked for, before its name or after it; alone, of the position."""


def _asked(*words: str) -> tuple[str, ...]:
    """What the desired value of a quantity with these words is called."""
    return tuple(text for word in words for d in DESIRED for text in (f"{word}_{d}", f"{d}_{word}"))


# channel -> words for it, beside its own name
SYNONYMS: Mapping[str, tuple[str, ...]] = {
    "q_des": (*_asked("q", "position", "positions", "pos", "angle", "joint_position"), "q_cmd", *DESIRED),
    "qd_des": _asked("qd", "dq", "qdot", "velocity", "velocities", "vel", "speed", "joint_velocity"),
    "qdd_des": _asked("qdd", "ddq", "qddot", "acceleration", "acc", "joint_acceleration"),
    "command_ff": ("tau_ff", "feedforward", "effort_ff", "effort_feedforward"),
    "command_fb": ("tau_fb", "feedback", "effort_fb", "effort_feedback"),
    "q": (
        *("position", "positions", "pos", "angle", "joint_position", "actual_q", "q_actual"),
        *("actual_position", "measured_position", "position_measured", "q_meas", "q_measured"),
    ),
    "qd": (
        *("dq", "qdot", "velocity", "velocities", "vel", "speed", "joint_velocity", "actual_qd"),
        *("qd_actual", "actual_velocity", "measured_velocity", "qd_meas", "qd_measured"),
    ),
    "qdd": ("ddq", "qddot", "acceleration", "acc", "joint_acceleration"),
    "command": ("tau", "u", "cmd"),
    "specific_force": ("acc", "accel", "accelerometer", "imu_acc", "a"),
    "rates": ("gyro", "gyroscope", "angular_velocity", "imu_gyro", "w", "omega"),
    "position": ("pos", "p", "state_estimate", "stateestimate"),
    "velocity": ("vel", "v", "state_estimate_v", "stateestimate_v"),
    "orientation": ("q", "quat", "quaternion", "attitude_q"),
    "attitude": ("stabilizer", "state_estimate", "stateestimate", "euler", "rpy"),
    "battery_voltage": ("vbat", "vbatt", "pm_vbat"),
    "position_des": ("position_ref", "setpoint", "p_des", *_asked("position", "pos", "p"), *DESIRED),
}
# Sensors that recorders write under several names at once: the first complete spelling is taken, as of plans.
SENSORS = ("specific_force", "rates", "position", "velocity", "orientation", "attitude", "position_des")
# Words for the learned command that only one unit of it can mean.
COMMANDS: Mapping[str, tuple[str, ...]] = {
    "N m": (
        "effort",
        "efforts",
        "torque",
        "torques",
        "actual_torque",
        "measured_torque",
        "joint_effort",
        "tau_j",
    ),
    "N": ("force", "effort", "efforts"),
    "A": ("current", "currents", "actual_current", "motor_current", "effort", "efforts"),
    "V": ("voltage", "motor_voltage", "effort", "efforts"),
    "pwm": ("pwm", "duty", "effort", "efforts"),
}
# Words for commands that do work on no coordinate of their own: set-points of motors.
_MOTORS = ("command", "motor", "pwm", "cmd", "u", "voltage", "actuator")
SETPOINTS = (*_MOTORS, "m", *(f"{word}_m" for word in _MOTORS))
PREFIXES = (
    *("joint_states", "joint_state", "joint", "joints", "state", "states", "robot", "robot_state"),
    "field",
)
UNITS: Mapping[str, float] = {
    **dict.fromkeys(("", "1", "rad", "rad/s", "rad/s2", "rad/s^2", "rad/s²"), 1.0),
    **dict.fromkeys(("m", "m/s", "m/s2", "m/s^2", "m/s²", "nm", "n m", "n*m", "n.m", "n"), 1.0),
    **dict.fromkeys(("a", "v", "pwm"), 1.0),
    **dict.fromkeys(("deg", "deg/s", "deg/s2", "deg/s^2", "deg/s²"), math.pi / 180),
    **dict.fromkeys(("°", "°/s", "degrees", "dps"), math.pi / 180),
    **dict.fromkeys(("mrad", "mm", "mm/s", "mnm", "ma", "mv"), 1e-3),
    **{"g": GRAVITY, "mg": 1e-3 * GRAVITY, "%": 0.01},
}
"""Unit in a header -> factor to SI."""
DIMENSIONS: Mapping[str, tuple[str, ...]] = {
    **{"N m": ("nm", "n m", "n*m", "n.m", "mnm"), "N": ("n",), "A": ("a", "ma"), "V": ("v", "mv")},
    **{"pwm": ("pwm", "%"), "1": ("1", "pwm", "%")},
}
"""Unit of a command -> units in a header that can be converted to it."""
SUFFIXES: Mapping[str, str] = {
    **{unit: unit for unit in ("rad", "deg", "degrees", "dps", "mrad", "mm", "nm", "mnm", "ma", "mv")},
    **{"rad_s": "rad/s", "rad_per_s": "rad/s", "rads": "rad/s", "radps": "rad/s", "rad_s2": "rad/s2"},
    **{"deg_s": "deg/s", "deg_per_s": "deg/s", "degps": "deg/s", "deg_s2": "deg/s2", "mm_s": "mm/s"},
}
"""Units at the end of a header without brackets, normalised; single letters are no units there."""
ALIKE: Mapping[str, tuple[str, ...]] = {
    **{"rad": ("rad", "deg", "degrees", "mrad"), "rad/s": ("rad/s", "deg/s", "dps")},
    **{"rad/s^2": ("rad/s2", "deg/s2"), "m": ("mm",), "m/s": ("mm/s",)},
    **DIMENSIONS,
}
"""Unit of a channel -> units of `SUFFIXES` that are of the same dimension: others are none of its."""
UNITS_TO_USE = "Use rad, rad/s, rad/s^2, deg, deg/s, m, m/s, m/s^2, g, N m, A, V or pwm."

TIME_WORDS = ("t", "time", "timestamp", "stamp", "time_stamp", "seconds", "timestamps")
STAMP_WORDS = {"sec": ("header_stamp_sec", "stamp_sec", "sec"), "nanosec": ("nanosec", "stamp_nanosec")}
TIME_UNITS: Mapping[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
NAMELESS = "unnamed column"
"""What a column without a header is called, and its number."""
NUMBERED = "column"
"""What all columns of a file without headers are called, and their numbers."""
INDEX = re.compile(r"unnamed(_column)?_\d+|index(_level_\d+)?")
"""Normalised headers of an index, as pandas and polars write one."""
MINUTES = {"min": 60.0}
"""Too near to seconds to be told from the rate: only where a header says so."""


def split_unit(header: str) -> tuple[str, str]:
    """('Elbow Position', 'deg') of 'Elbow Position [deg]'; a bare number in brackets is an index, no unit;
    nothing but brackets is a header of two names, ('elbow', 'position').
    """
    found = re.search(r"\s*[\[(]([^\])]*)[\])]\s*$", header)
    if found is None or found.start() == 0 or found.group(1).strip().isdigit():
        return header, ""
    return header[: found.start()], found.group(1).strip().lower()


def split_suffix(header: str) -> tuple[str, str]:
    """('q1', 'deg') of 'q1_deg', ('dq1', 'rad/s') of 'dq1 rad/s'; without brackets, see `split_unit`."""
    text = normal(header)
    for suffix in sorted(SUFFIXES, key=len, reverse=True):
        if text.endswith(f"_{suffix}"):
            return text.removesuffix(f"_{suffix}"), SUFFIXES[suffix]
    return header, ""


def unit_of(header: str) -> str:
    """The unit that a header states, in brackets or at its end; "" if none."""
    return split_unit(header)[1] or split_suffix(header)[1]


def normal(text: str) -> str:
    """Lower case, every run of other characters than letters and digits one underscore."""
    return re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")


def is_time(header: str) -> bool:
    """Whether a header says time, or a part of a time stamp."""
    text = normal(split_unit(header)[0])
    stamps = [word for words in STAMP_WORDS.values() for word in words]
    return time_word(text) in TIME_WORDS or text in stamps or text.endswith("stamp_nanosec")


def time_word(text: str) -> str:
    """A normalised header less a unit at its end: "time" of "time_ms"."""
    for unit in (*TIME_UNITS, *MINUTES):
        if text.endswith(f"_{unit}"):
            return text.removesuffix(f"_{unit}")
    return text
