"""PX4's flight logs as raw logs: the topics that an inverse model needs, in the frames of Étude.

PX4's body frame is x forward, y right, z down and its world north, east, down. Here the body's y points left
and its z up, and the world is east, north, up, as ROS has it (REP 103, 105).
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from etude.errors import DataError
from etude.logs.readers.extras import READING, needed
from etude.logs.readers.frames import raw_log
from etude.types import Array, Log
from etude_quadrotor.spec import QuadrotorSpec
from etude_quadrotor.spec_file import lacking_forces
from etude_quadrotor.vehicle import Rotor

MAGIC = b"\x55\x4c\x6f\x67\x01\x12\x35"
HEADER = 3
"""Bytes before a message: its size and kind."""
DAMAGED = "The log is damaged; the damaged parts were ignored."
CUT = "The log was cut: its last message is incomplete, and later ones are missing."
AXES = ("x", "y", "z")
GYRO = ("vehicle_angular_velocity", "sensor_combined")
FORCE = ("sensor_combined", "vehicle_acceleration")
BATTERY = "battery_status"
"""Topics and fields of a signal, in order of precedence."""
STATED = {
    "THR_MDL_FAC": ("thrust_curve", QuadrotorSpec.thrust_curve),
    "MC_ROLL_P": ("attitude_gain", QuadrotorSpec.attitude_gain),
    "MPC_XY_VEL_D_ACC": ("velocity_damping", QuadrotorSpec.velocity_damping),
}
"""Parameters that robot.toml states: its key, and the value without it."""
HALF = np.sqrt(0.5)
ENU_NED = np.array([0.0, HALF, HALF, 0.0])
FRD_FLU = np.array([0.0, 1.0, 0.0, 0.0])


class UlogReader:
    """A `protocols.Reader` of PX4's ULog."""

    def __call__(self, path: Path, topics: Sequence[str] = ()) -> Mapping[str, Log]:
        """A log for each of PX4's topics that an inverse model needs, or for each requested topic unchanged.

        Raises:
            DataError: not a ULog, no such topic, or no topic on the motion of the body and the motors.
            UsageError: pyulog is not installed.
        """
        ulog, cut = _parsed(path, topics or _flight_topics())
        instances: dict[str, list[Any]] = {}
        for one in ulog.data_list:
            if len(one.data.get("timestamp", ())):
                instances.setdefault(one.name, []).append(one.data)
        missing = [topic for topic in topics if topic not in instances]
        if missing:
            raise _unknown(path, missing[0])
        notes = (DAMAGED,) * ulog.file_corruption + (CUT,) * cut
        if topics:
            return {name: _log(instances[name][0], dict(instances[name][0]), path, notes) for name in topics}
        return _flight(instances, ulog.initial_parameters, path, notes)

    def recognises(self, path: Path, head: bytes) -> bool:  # noqa: ARG002
        """Whether the file is a ULog, by its first bytes."""
        return head.startswith(MAGIC)


class _Patient:
    """A file with a bounded number of reads: in some damaged files pyulog loops for ever.

    pyulog reads a message in two parts, header and content. After damage it tries every byte as a start, and
    it does not report an incomplete message.
    """

    def __init__(self, file: BinaryIO) -> None:
        self.cut = False
        """Whether the last message is incomplete."""
        self._file, self._announced = file, -1
        self._left = 1000 + 3 * file.seek(0, io.SEEK_END)
        file.seek(0)

    def read(self, size: int = -1) -> bytes:
        """RuntimeError: it has been read too often."""
        self._left -= 1
        if self._left < 0:
            raise RuntimeError("it is damaged: its records form a circle")
        data = self._file.read(size)
        if size == HEADER:
            self.cut, self._announced = 0 < len(data) < size, int.from_bytes(data[:2], "little")
        elif size == self._announced:
            self.cut = len(data) < size
        return data

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


MOTORS = ("actuator_motors", "actuator_outputs")
"""Topics of the motors, in order of precedence."""
PULSE = (800.0, 2200.0)
"""us: plausible pulse widths of a motor."""
ROTORS = 4
"""Number of motors if the log does not state it."""
SLOW = 50.0
"""Hz: at lower rates set-points of motors are undersampled."""

Dataset = Mapping[str, Array]
"""Field -> (T,); `timestamp` in us."""


def motors_of(
    instances: Sequence[Dataset], topic: str, parameters: Mapping[str, Any], notes: list[str]
) -> tuple[Dataset, dict[str, Array]]:
    """Set-points of the motors, parts of full scale, numbered as PX4 does, and their topic's instance.

    Args:
        instances: of the topic; that whose outputs move is of the motors.
        topic: one of MOTORS.
        parameters: PX4's, at the beginning of the log.
        notes: receives a sentence for each note.
    """
    stem, count = "control" if topic == "actuator_motors" else "output", rotor_count(parameters)
    data = max(instances, key=lambda one: sum(moves(one, f"{stem}[{i}]") for i in range(count or ROTORS)))
    rate = (len(data["timestamp"]) - 1) / max(1e-6 * float(np.ptp(data["timestamp"].astype(float))), 1e-6)
    if rate < SLOW:
        notes.append(
            f"Topic {topic} was recorded {rate:.3g} times a second, too few to show the motor commands: "
            "set SDLOG_PROFILE on the vehicle to record it faster."
        )
    if topic == "actuator_motors":
        named = [i for i in range(count or MOST) if f"control[{i}]" in data]
        indices = [i for i in named if np.isfinite(data[f"control[{i}]"]).any()]
        return data, _zero_while_disarmed({f"motor_{i + 1}": data[f"control[{i}]"] for i in indices}, notes)
    indices = [i for i in range(count or ROTORS) if f"output[{i}]" in data]
    notes.append(f"Outputs 1 to {len(indices)} of {topic} were read as the motors.")
    return data, {
        f"motor_{i + 1}": _fraction_of_pulses(data[f"output[{i}]"], i, parameters, notes) for i in indices
    }


def _zero_while_disarmed(motors: dict[str, Array], notes: list[str]) -> dict[str, Array]:
    """Set-points with 0 in place of NaN, which PX4 writes while it is disarmed."""
    off = np.all([np.isnan(values) for values in motors.values()], axis=0)
    if not np.any(off):
        return motors
    notes.append(
        f"For {100 * off.mean():.3g} % of actuator_motors the vehicle is disarmed (NaN), so its motors "
        "were set to 0."
    )
    return {name: np.where(off, 0.0, values) for name, values in motors.items()}


def moves(data: Dataset, name: str) -> bool:
    """Whether a field exists and changes."""
    values = np.asarray(data.get(name, (0.0,)), dtype=np.float64)
    return bool(np.nanmax(values, initial=-np.inf) > np.nanmin(values, initial=np.inf))


def _fraction_of_pulses(pulses: Array, i: int, parameters: Mapping[str, Any], notes: list[str]) -> Array:
    """Parts of full scale from pulse widths in us, between PX4's configured minimum and maximum."""
    median = float(np.nanmedian(pulses))
    if not PULSE[0] <= median <= PULSE[1]:
        notes.append(f"Output {i + 1} is not a pulse width (median {median:.4g}) and was used unchanged.")
        return pulses
    ends = []
    # us, PX4's defaults
    for end, usual in (("MIN", 1000.0), ("MAX", 2000.0)):
        names = (f"PWM_MAIN_{end}{i + 1}", f"PWM_MAIN_{end}", f"PWM_{end}")
        ends.append(next((float(parameters[n]) for n in names if parameters.get(n, -1) > 0), usual))
    low, high = ends
    return (pulses - low) / max(high - low, 1.0)


STATUS = "vehicle_status"
"""The topic that repeats MAV_TYPE as `system_type`, and says `vehicle_type` and `is_vtol`."""
MULTIROTORS: Mapping[int, int] = {2: 4, 13: 6, 14: 8, 29: 12, 35: 10}
"""MAV_TYPE of what may be a flat multirotor, and its number of motors."""
MOST = 12
"""Motors in actuator_motors."""
# MAV_TYPE of MAVLink's common.xml; the same numbers stand in vehicle_status.system_type
TYPES: Mapping[int, str] = {
    1: "a fixed-wing aircraft",
    3: "a coaxial helicopter",
    4: "a helicopter",
    7: "an airship",
    10: "a ground rover",
    11: "a boat",
    12: "a submarine",
    15: "a tricopter",
    **dict.fromkeys(range(19, 26), "a VTOL aircraft"),
}
AIRFRAMES: Mapping[int, str] = {
    1: "a fixed-wing aircraft",
    **dict.fromkeys((2, 3, 4), "a VTOL aircraft"),
    5: "a rover",
    6: "a rover",
    7: "an underwater vehicle",
    8: "a multirotor whose rotors tilt",
    **dict.fromkeys((10, 11, 12), "a helicopter"),
    13: "a rover",
}
"""Of PX4's parameter CA_AIRFRAME; 0 is a multirotor, the others may be anything."""
VEHICLES: Mapping[int, str] = {2: "a fixed-wing aircraft", 3: "a rover", 4: "an airship"}
"""vehicle_status.vehicle_type; 1 is a rotary wing."""


AXIS = {"AX": 0.0, "AY": 0.0, "AZ": -1.0}
"""Of each rotor's thrust, by PX4's parameters CA_ROTORi_AX, ...; forward, right, down."""
TILTED = 0.02
"""Tolerance: 1 degree."""


def rotor_count(parameters: Mapping[str, Any]) -> int:
    """Number of motors by CA_ROTOR_COUNT, else by MAV_TYPE; 0 if neither states it."""
    return int(parameters.get("CA_ROTOR_COUNT", 0)) or MULTIROTORS.get(int(parameters.get("MAV_TYPE", 0)), 0)


def rotors_of(parameters: Mapping[str, Any]) -> tuple[Rotor, ...]:
    """Positions and spins of the motors, in PX4's order; () if the parameters do not state them.

    PX4: x forward, y right; KM is positive for a rotor that spins counter-clockwise, seen from above.
    """
    names = [f"CA_ROTOR{i}_" for i in range(rotor_count(parameters))]
    if not all(f"{name}{key}" in parameters for name in names for key in ("PX", "PY", "KM")):
        return ()
    return tuple(
        (
            float(parameters[f"{name}PX"]),
            0.0 - float(parameters[f"{name}PY"]),
            float(np.sign(parameters[f"{name}KM"])),
        )
        for name in names
    )


def require_flat_multirotor(
    parameters: Mapping[str, Any], status: Sequence[Mapping[str, Any]], path: Path
) -> None:
    """Refuses the log of another airframe, whose actuators are not motors with thrust along z.

    Args:
        parameters: PX4's, at the beginning of the log. status: instances of STATUS.

    Raises:
        DataError: it names the airframe and the parameter that states it; or the moments that its rotors
            lack.
    """
    unsupported = _unsupported_airframe(parameters, status[0] if status else {})
    if unsupported is not None:
        name, parameter = unsupported
        raise DataError(
            f"the vehicle of this log is {name} ({parameter}), and only flat multirotors are supported",
            where=str(path),
            next_step="Use a log of a vehicle with four rotors or more that all lift along its z axis; "
            "--topic NAME reads a topic as recorded.",
        )
    rotors = rotors_of(parameters)
    if lacking := lacking_forces(rotors) if rotors else "":
        raise DataError(
            f"the allocation matrix of CA_ROTOR parameters is singular: these rotors cannot make {lacking}",
            where=str(path),
            next_step="Correct CA_ROTORi_PX, _PY and _KM on the vehicle; --topic NAME reads one as recorded.",
        )


def _unsupported_airframe(parameters: Mapping[str, Any], status: Mapping[str, Any]) -> tuple[str, str] | None:
    """The airframe and the parameter that states it; None for a flat multirotor, or if unknown."""
    if int(_median_value(status, "is_vtol", 0)):
        return "a VTOL aircraft", f"{STATUS}.is_vtol"
    for parameter, number in (
        ("MAV_TYPE", int(parameters.get("MAV_TYPE", 0))),
        (f"{STATUS}.system_type", int(_median_value(status, "system_type", 0))),
    ):
        if number and number not in MULTIROTORS:
            return TYPES.get(number, "no multirotor"), f"{parameter} {number}"
    frame = int(parameters.get("CA_AIRFRAME", 0))
    if frame in AIRFRAMES:
        return AIRFRAMES[frame], f"CA_AIRFRAME {frame}"
    kind = int(_median_value(status, "vehicle_type", 1))
    if kind in VEHICLES:
        return VEHICLES[kind], f"{STATUS}.vehicle_type {kind}"
    count = rotor_count(parameters)
    if count and not ROTORS <= count <= MOST:
        return f"a vehicle of {count} rotors", f"CA_ROTOR_COUNT {count}"
    return _tilted(parameters, count)


def _tilted(parameters: Mapping[str, Any], count: int) -> tuple[str, str] | None:
    """A multirotor that is not flat, by the first axis of a rotor that is not along z."""
    for i in range(count):
        for axis, flat in AXIS.items():
            value = float(parameters.get(name := f"CA_ROTOR{i}_{axis}", flat))
            if abs(value - flat) > TILTED:
                return "a multirotor with tilted rotors", f"{name} {value:g}"
        if int(parameters.get(name := f"CA_ROTOR{i}_TILT", 0)):
            return "a multirotor whose rotors tilt", f"{name} {parameters[name]}"
    return None


def _median_value(data: Mapping[str, Any], name: str, missing: int) -> float:
    """The median of a field, or the default if the topic has no such field."""
    values = np.asarray(data.get(name, ()))
    return float(np.median(values)) if len(values) else missing


def _flight_topics() -> list[str]:
    return sorted({STATUS, *MOTORS, *(name for names, _ in SIGNALS for name in names)})


def _parsed(path: Path, topics: Sequence[str]) -> tuple[Any, bool]:
    """The file as read by pyulog, and whether its end is missing; output of pyulog is suppressed."""
    library = needed("pyulog", READING, path)
    with path.open("rb") as file, contextlib.redirect_stdout(io.StringIO()):
        if file.read(len(MAGIC)) != MAGIC:
            raise DataError(
                "this is not a ULog", where=str(path), next_step="Download the .ulg of the flight again."
            )
        try:
            patient = _Patient(file)
            return library.ULog(patient, list(topics) or None), patient.cut
        except Exception as problem:  # pyulog raises any exception
            first = (str(problem).strip().splitlines() or [type(problem).__name__])[0][:200]
            raise DataError(
                f"the file cannot be read as ULog ({first})",
                where=str(path),
                next_step="It is truncated or damaged; download the log again.",
            ) from None


def _missing_topics_error(path: Path, missing: Sequence[str], present: Iterable[str] = ()) -> DataError:
    """The error for a log without the topics `missing`, which learning needs."""
    return DataError(
        f"the log has no topic {' or '.join(missing)}",
        where=str(path),
        next_step=f"Of the required topics it has {', '.join(sorted(present)) or 'none'}. Set "
        "SDLOG_PROFILE on the vehicle, or name the topics in etc/logging/logger_topics.txt on its "
        "card; --topic NAME reads one as recorded.",
    )


def _unknown(path: Path, topic: str) -> DataError:
    every = {one.name for one in _parsed(path, ())[0].data_list}
    return DataError(
        f"the log has no topic {topic}",
        where=str(path),
        next_step=f"It has {', '.join(sorted(every)) or 'none'}.",
    )


def _flight(
    instances: Mapping[str, list[Dataset]], parameters: Mapping[str, Any], path: Path, notes: tuple[str, ...]
) -> dict[str, Log]:
    """A log for each topic with data of the flight.

    Raises:
        DataError: the file has no data of the body or of the motors.
    """
    require_flat_multirotor(parameters, instances.get(STATUS, ()), path)
    if lacking := [names for names in (GYRO, FORCE, MOTORS) if not any(name in instances for name in names)]:
        raise _missing_topics_error(path, lacking[0], instances)
    sentences = ["Axes were turned: body x forward, y left, z up; world east, north, up."]
    if rotors := rotors_of(parameters):
        text = ", ".join(f"[{x:.4g}, {y:.4g}, {spin:g}]" for x, y, spin in rotors)
        sentences.append(
            f"Motors 1 to {len(rotors)} by CA_ROTOR parameters, for robot.toml: rotors = [{text}]."
        )
    for parameter, (key, usual) in STATED.items():
        value = float(parameters.get(parameter, usual))
        if not np.isclose(value, usual):  # the log is in single precision
            sentences.append(f"{parameter} is {value:.3g}, for robot.toml: {key} = {value:.3g}.")
    parts: list[tuple[str, Dataset, dict[str, Array]]] = []
    for names, columns_of in SIGNALS:
        name = next((one for one in names if one in instances), None)
        if name is not None:
            parts.append((name, instances[name][0], columns_of(instances[name][0])))
    motors = next((name for name in MOTORS if name in instances), None)
    if motors is not None:
        parts.append((motors, *motors_of(instances[motors], motors, parameters, sentences)))
    columns: dict[str, dict[str, Array]] = {}
    for name, _, part in parts:  # one topic may hold two signals
        columns.setdefault(name, {}).update(part)
    data = {name: part for name, part, _ in parts}
    if BATTERY in data:
        data[BATTERY] = _extended_to_flight(data[BATTERY], columns[BATTERY], data.values())
    return {
        name: _log(data[name], part, path, (*notes, *sentences)) for name, part in columns.items() if part
    }


def _log(data: Dataset, columns: Mapping[str, Array], path: Path, notes: tuple[str, ...]) -> Log:
    """Raw columns at the times of the topic, s since the vehicle started."""
    signals = {name: np.asarray(values, dtype=np.float64) for name, values in columns.items()}
    # PX4 stamps in us
    t = np.asarray(data["timestamp"], dtype=np.float64) * 1e-6
    return replace(raw_log(signals, path.name, notes), t=t)


def _rates(data: Dataset) -> dict[str, Array]:
    return _body(data, ("xyz", "gyro_rad"), "gyro", "rad/s")


def _force(data: Dataset) -> dict[str, Array]:
    return _body(data, ("accelerometer_m_s2", "xyz"), "acc", "m/s^2")


def _body(data: Dataset, stems: Sequence[str], word: str, unit: str) -> dict[str, Array]:
    """A vector in the body frame, from forward, right, down to forward, left, up."""
    stem = next((one for one in stems if f"{one}[0]" in data), None)
    if stem is None:
        return {}
    signs = (1.0, -1.0, -1.0)
    return {f"{word}_{a} [{unit}]": signs[i] * data[f"{stem}[{i}]"] for i, a in enumerate(AXES)}


def _orientation(data: Dataset) -> dict[str, Array]:
    if "q[3]" not in data:
        return {}
    q = np.stack([np.asarray(data[f"q[{i}]"], dtype=np.float64) for i in range(4)], axis=1)
    q = turned(q)
    # q and -q are the same attitude: neighbours get the same sign, since they are interpolated
    flips = np.cumprod(np.where(np.sum(q[1:] * q[:-1], axis=1) < 0.0, -1.0, 1.0))
    q[1:] *= flips[:, None]
    return {f"quat_{part}": q[:, i] for i, part in enumerate("wxyz")}


def turned(q: Array) -> Array:
    """(T, 4) w, x, y, z of (east, north, up) <- (forward, left, up) from that of PX4."""
    return _product(_product(ENU_NED, q), FRD_FLU)


def _product(p: Array, q: Array) -> Array:
    pw, px, py, pz = np.moveaxis(p, -1, 0)
    qw, qx, qy, qz = np.moveaxis(q, -1, 0)
    rows = (
        pw * qw - px * qx - py * qy - pz * qz,
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
    )
    return np.stack(rows, axis=-1)


def _place(data: Dataset) -> dict[str, Array]:
    """Position and velocity, from north, east, down to east, north, up."""
    source = (("y", 1.0), ("x", 1.0), ("z", -1.0))
    columns = {}
    for prefix, word, unit in (("", "position", "m"), ("v", "velocity", "m/s")):
        if all(f"{prefix}{name}" in data for name, _ in source):
            for axis, (name, sign) in zip(AXES, source, strict=True):
                columns[f"{word}_{axis} [{unit}]"] = sign * data[f"{prefix}{name}"]
    return columns


def _battery(data: Dataset) -> dict[str, Array]:
    """Without a power module PX4 writes 0 V and -1 A, which are not measurements."""
    headers = {"voltage_v": "battery_voltage [V]", "current_a": "battery_current [A]"}
    return {
        header: data[name] for name, header in headers.items() if np.any(data.get(name, np.zeros(1)) > 0.0)
    }


def _extended_to_flight(data: Dataset, columns: dict[str, Array], others: Iterable[Dataset]) -> Dataset:
    """A slow topic, with its first and last row repeated at the ends of the flight."""
    times = [float(one["timestamp"][k]) for one in others for k in (0, -1)]
    for name, values in columns.items():
        columns[name] = np.concatenate([values[:1], values, values[-1:]])
    return {"timestamp": np.concatenate([[min(times)], data["timestamp"], [max(times)]])}


def _speed_controllers(data: Dataset) -> dict[str, Array]:
    """What each reports; asides of a flight."""
    headers = {"esc_rpm": "esc_rpm_{}", "esc_current": "esc_current_{} [A]"}
    return {
        header.format(i + 1): data[f"esc[{i}].{name}"]
        for name, header in headers.items()
        for i in range(8)
        if moves(data, f"esc[{i}].{name}")
    }


SIGNALS: Sequence[tuple[Sequence[str], Callable[[Dataset], dict[str, Array]]]] = (
    (GYRO, _rates),
    (FORCE, _force),
    (("vehicle_attitude",), _orientation),
    (("vehicle_local_position",), _place),
    (("esc_status",), _speed_controllers),
    ((BATTERY,), _battery),
)
"""Topics of a signal, of which the first existing one is read, and their columns."""

read_ulog = UlogReader()
