"""Which column of a flight's table is what: matched by name, in any case and punctuation.

Vectors are a word and an axis, `gyro_x` or `w.x [deg/s]`; commands are the vehicle's own names, with or
without `command`, `motor` or `pwm` before them, or their numbers, `motor_1` .. `motor_4`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError
from etude.logs.columns import normal, split_unit
from etude.logs.table import Table
from etude.robots.flight_spec import FlightSpec
from etude.robots.vehicle import GRAVITY

Array = NDArray[np.float64]

VECTORS: dict[str, tuple[str, ...]] = {
    "specific_force": ("specific_force", "acc", "accel", "accelerometer", "imu_acc", "a"),
    "rates": ("rates", "gyro", "gyroscope", "angular_velocity", "imu_gyro", "w", "omega"),
    "position": ("position", "pos", "p", "state_estimate", "stateestimate"),
    "velocity_world": ("velocity", "vel", "v"),
    "position_des": ("position_des", "position_ref", "setpoint", "p_des", "ref_position"),
}
ATTITUDE = {"quaternion": ("q", "quat", "quaternion", "attitude_q"), "euler": ("roll", "pitch", "yaw")}
PREFIXES = ("command", "motor", "pwm", "cmd", "u", "voltage", "actuator")
UNITS: dict[str, float] = {
    **dict.fromkeys(("", "m", "m/s", "m/s2", "m/s^2", "rad", "rad/s", "v", "1"), 1.0),
    **dict.fromkeys(("deg", "deg/s", "°", "°/s", "dps"), math.pi / 180.0),
    **dict.fromkeys(("mm", "mm/s", "mv"), 1e-3),
    **{"g": GRAVITY, "mg": 1e-3 * GRAVITY, "%": 0.01},
}


@dataclass(frozen=True)
class FlightColumns:
    """SI columns of a flight's table; None where the file has none.

    Attributes:
        vectors: (T, 3) by the keys of VECTORS.
        R_world_body: (T, 3, 3) attitude, or None.
        command: (T, 4).
        stated: units that headers stated, by vector.
    """

    vectors: dict[str, Array | None]
    R_world_body: Array | None
    command: Array
    stated: frozenset[str]


def flight_columns(table: Table, spec: FlightSpec, where: str) -> FlightColumns:
    """The columns of `table` that a flight of `spec` needs.

    Raises:
        DataError: no accelerometer, gyroscope or command, or an unknown unit; names what is there.
    """
    found: dict[str, Array] = {}
    units: dict[str, str] = {}
    for header, values in table.columns.items():
        bare, unit = split_unit(header)
        key = normal(bare)
        if unit in UNITS:
            found[key], units[key] = values * UNITS[unit], unit
        elif _known(key, spec):
            raise DataError(
                f"unknown unit '{unit}'",
                where=f"{where}, column '{header}'",
                next_step="Use m, m/s, m/s^2, g, rad, rad/s, deg, deg/s or V.",
            )
    vectors, stated = {}, set()
    for name, words in VECTORS.items():
        keys = next((k for k in _spellings(words, "xyz") if all(key in found for key in k)), None)
        vectors[name] = None if keys is None else np.stack([found[key] for key in keys], axis=1)
        if keys is not None and units[keys[0]]:
            stated.add(name)
    for name in ("specific_force", "rates"):
        if vectors[name] is None:
            examples = ", ".join(f"{VECTORS[name][1]}_{axis}" for axis in "xyz")
            raise DataError(
                f"there is no {name.replace('_', ' ')}",
                where=where,
                next_step=f"Name the columns {examples}; the file has {', '.join(table.columns)}.",
            )
    return FlightColumns(vectors, _attitude(found), _command(found, spec, where), frozenset(stated))


def _spellings(words: tuple[str, ...], parts: str) -> list[list[str]]:
    """Normalised header names of a vector, by word: `gyro_x`, `gyrox`, `gyro_0`."""
    styles = ("{word}_{part}", "{word}{part}")
    named = [[s.format(word=w, part=p) for p in parts] for w in words for s in styles]
    return named + [[f"{w}_{i}" for i in range(len(parts))] for w in words]


def _known(key: str, spec: FlightSpec) -> bool:
    vectors = any(key in keys for words in VECTORS.values() for keys in _spellings(words, "xyz"))
    return vectors or any(key.endswith(normal(name)) for name in spec.command_names)


def _command(found: dict[str, Array], spec: FlightSpec, where: str) -> Array:
    columns = []
    for number, name in enumerate(spec.command_names, start=1):
        plain = normal(name)
        numbered = [f"{p}{s}{number}" for p in (*PREFIXES, "m") for s in ("_", "", "_m")]
        keys = [plain, *(f"{prefix}_{plain}" for prefix in PREFIXES), *numbered]
        key = next((k for k in keys if k in found), None)
        if key is None:
            raise DataError(
                f"there is no command '{name}'",
                where=where,
                next_step=f"Name its column command_{plain} or motor_{number}, or correct robot.toml.",
            )
        columns.append(found[key])
    return np.stack(columns, axis=1)


def _attitude(found: dict[str, Array]) -> Array | None:
    """R_world_body (T, 3, 3) of a quaternion (w, x, y, z) or of roll, pitch, yaw (z-y'-x''); may hold NaN."""
    from scipy.spatial.transform import Rotation

    keys = next(
        (k for k in _spellings(ATTITUDE["quaternion"], "wxyz") if all(key in found for key in k)), None
    )
    keys = keys or ([*ATTITUDE["euler"]] if all(key in found for key in ATTITUDE["euler"]) else None)
    if keys is None:
        return None
    values = np.stack([found[key] for key in keys], axis=1)
    good = np.isfinite(values).all(axis=1)
    if len(keys) == 4:
        good &= np.linalg.norm(values, axis=1) > 0.5
        made = Rotation.from_quat(values[good][:, [1, 2, 3, 0]])
    else:
        made = Rotation.from_euler("ZYX", values[good][:, ::-1])
    R_world_body = np.full((len(values), 3, 3), np.nan)
    R_world_body[good] = made.as_matrix()
    return R_world_body
