"""Vocabulary of headers as rows of data: words for channels, units, and words for time."""

from __future__ import annotations

import re
from collections.abc import Mapping

DESIRED = ("des", "desired", "ref", "reference", "target", "setpoint", "goal")
"""Words that say of a quantity that it is asked for, before its name or after it; alone, of the position."""


def _desired(*words: str) -> tuple[str, ...]:
    """What the desired value of a quantity with these words is called."""
    return tuple(text for word in words for d in DESIRED for text in (f"{word}_{d}", f"{d}_{word}"))


# channel -> words for it, beside its own name
SYNONYMS: Mapping[str, tuple[str, ...]] = {
    "q_des": (*_desired("q", "position", "positions", "pos", "angle", "joint_position"), "q_cmd", *DESIRED),
    "qd_des": _desired("qd", "dq", "qdot", "velocity", "velocities", "vel", "speed", "joint_velocity"),
    "qdd_des": _desired("qdd", "ddq", "qddot", "acceleration", "acc", "joint_acceleration"),
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
    "position_des": ("position_ref", "setpoint", "p_des", *_desired("position", "pos", "p"), *DESIRED),
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
SUFFIXES: Mapping[str, str] = {
    **{unit: unit for unit in ("rad", "deg", "degrees", "dps", "mrad", "mm", "nm", "mnm", "ma", "mv", "rpm")},
    **{
        unit: unit
        for unit in ("radians", "degree", "amps", "volts", "counts", "ticks", "percent", "permille")
    },
    **{"rad_s": "rad/s", "rad_per_s": "rad/s", "rads": "rad/s", "radps": "rad/s", "rad_s2": "rad/s2"},
    **{"deg_s": "deg/s", "deg_per_s": "deg/s", "degps": "deg/s", "deg_s2": "deg/s2", "mm_s": "mm/s"},
    **{"rad_sec": "rad/s", "deg_sec": "deg/s", "rad_per_sec": "rad/s", "deg_per_sec": "deg/s", "n_m": "nm"},
}
"""Units at the end of a header without brackets, normalised; single letters are no units there."""

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
TIME_SPELLINGS: Mapping[str, str] = {
    **dict.fromkeys(("sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("msec", "msecs", "millis", "milliseconds"), "ms"),
    **dict.fromkeys(("usec", "usecs", "µs", "μs", "micros", "microseconds"), "us"),
    **dict.fromkeys(("nsec", "nsecs", "nanosec", "nanos", "nanoseconds"), "ns"),
    **dict.fromkeys(("minute", "minutes"), "min"),
}
"""Other spellings of the units of time."""


def split_unit(header: str) -> tuple[str, str]:
    """('Elbow Position', 'deg') of 'Elbow Position [deg]'; a bare number in brackets is an index, no unit;
    nothing but brackets is a header of two names, ('elbow', 'position').
    """
    match = re.search(r"\s*[\[(]([^\])]*)[\])]\s*$", header)
    if match is None or match.start() == 0 or match.group(1).strip().isdigit():
        return header, ""
    return header[: match.start()], match.group(1).strip().lower()


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


def as_written(header: str, unit: str) -> str:
    """That unit as the header spells it: mNm, where `unit_of` gives small letters."""
    at = header.lower().rfind(unit)
    return header[at : at + len(unit)] if at >= 0 else unit


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
    if text in (word for words in STAMP_WORDS.values() for word in words):
        return text
    for unit in (*TIME_UNITS, *MINUTES, *TIME_SPELLINGS):
        if text.endswith(f"_{unit}"):
            return text.removesuffix(f"_{unit}")
    return text
