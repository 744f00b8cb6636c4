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
from etude_quadrotor.logs.ulog_airframe import STATUS, require_quadrotor
from etude_quadrotor.logs.ulog_motors import MOTORS, Dataset, motors_of, moves

MAGIC = b"\x55\x4c\x6f\x67\x01\x12\x35"
HEADER = 3
"""Bytes before a message: its size and kind."""
DAMAGED = "The log is damaged in places, which were left out."
CUT = "The log was cut: its last message is not whole, and what followed is missing."
AXES = ("x", "y", "z")
GYRO = ("vehicle_angular_velocity", "sensor_combined")
FORCE = ("sensor_combined", "vehicle_acceleration")
BATTERY = "battery_status"
"""Where a signal stands, in the order in which it is looked for."""
HALF = np.sqrt(0.5)
ENU_NED = np.array([0.0, HALF, HALF, 0.0])
FRD_FLU = np.array([0.0, 1.0, 0.0, 0.0])


class UlogReader:
    """A `protocols.Reader` of PX4's ULog."""

    def __call__(self, path: Path, topics: Sequence[str] = ()) -> Mapping[str, Log]:
        """A log for each of PX4's topics that an inverse model needs, or, as recorded, of those asked for.

        Raises:
            DataError: no ULog, no such topic, or none of those that tell what the body and the motors did.
            UsageError: pyulog is not installed.
        """
        ulog, cut = _parsed(path, topics or _needed())
        found: dict[str, list[Any]] = {}
        for one in ulog.data_list:
            if len(one.data.get("timestamp", ())):
                found.setdefault(one.name, []).append(one.data)
        missing = [topic for topic in topics if topic not in found]
        if missing:
            raise _unknown(path, missing[0])
        said = (DAMAGED,) * ulog.file_corruption + (CUT,) * cut
        if topics:
            return {name: _log(found[name][0], dict(found[name][0]), path, said) for name in topics}
        return _flight(found, ulog.initial_parameters, path, said)

    def recognises(self, path: Path, head: bytes) -> bool:  # noqa: ARG002
        """By its first bytes."""
        return head.startswith(MAGIC)


class _Patient:
    """A file that is read a bounded number of times: in some damaged ones pyulog goes round for ever.

    It reads a message in two parts, its size and kind and what it says, and after damage tries every byte as
    a beginning. That a message is not whole it keeps to itself.
    """

    def __init__(self, file: BinaryIO) -> None:
        self.cut = False
        """Whether the last message is not whole."""
        self._file, self._announced = file, -1
        self._left = 1000 + 3 * file.seek(0, io.SEEK_END)
        file.seek(0)

    def read(self, size: int = -1) -> bytes:
        """RuntimeError: it has been read too often."""
        self._left -= 1
        if self._left < 0:
            raise RuntimeError("damage in it leads round in a circle")
        data = self._file.read(size)
        if size == HEADER:
            self.cut, self._announced = 0 < len(data) < size, int.from_bytes(data[:2], "little")
        elif size == self._announced:
            self.cut = len(data) < size
        return data

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


def _needed() -> list[str]:
    return sorted({STATUS, *MOTORS, *(name for names, _ in SIGNALS for name in names)})


def _parsed(path: Path, topics: Sequence[str]) -> tuple[Any, bool]:
    """The file as pyulog reads it, and whether its end is missing; what pyulog prints is not shown."""
    library = needed("pyulog", READING, path)
    with path.open("rb") as file, contextlib.redirect_stdout(io.StringIO()):
        if file.read(len(MAGIC)) != MAGIC:
            raise DataError(
                "this is no ULog", where=str(path), next_step="Download the .ulg of the flight again."
            )
        try:
            patient = _Patient(file)
            return library.ULog(patient, list(topics) or None), patient.cut
        except Exception as problem:  # pyulog fails with anything
            first = (str(problem).strip().splitlines() or [type(problem).__name__])[0][:200]
            raise DataError(
                f"the file cannot be read as ULog ({first})",
                where=str(path),
                next_step="It is cut or damaged; download the log again.",
            ) from None


def _lacks(path: Path, missing: Sequence[str], found: Iterable[str] = ()) -> DataError:
    """No flight can be learned from without one of the topics `missing`."""
    return DataError(
        f"the log has no topic {' or '.join(missing)}",
        where=str(path),
        next_step=f"Of what is needed it has {', '.join(sorted(found)) or 'nothing'}. Set SDLOG_PROFILE on "
        "the vehicle, or name the topics in etc/logging/logger_topics.txt on its card; --topic NAME reads "
        "one as recorded.",
    )


def _unknown(path: Path, topic: str) -> DataError:
    every = {one.name for one in _parsed(path, ())[0].data_list}
    return DataError(
        f"the log has no topic {topic}",
        where=str(path),
        next_step=f"It has {', '.join(sorted(every)) or 'none'}.",
    )


def _flight(
    found: Mapping[str, list[Dataset]], parameters: Mapping[str, Any], path: Path, said: tuple[str, ...]
) -> dict[str, Log]:
    """A log for each topic that says something of the flight.

    Raises:
        DataError: nothing tells what the body or the motors did.
    """
    require_quadrotor(parameters, found.get(STATUS, ()), path)
    if lacking := [names for names in (GYRO, FORCE, MOTORS) if not any(name in found for name in names)]:
        raise _lacks(path, lacking[0], found)
    sentences = ["Axes were turned: body x forward, y left, z up; world east, north, up."]
    parts: list[tuple[str, Dataset, dict[str, Array]]] = []
    for names, columns_of in SIGNALS:
        name = next((one for one in names if one in found), None)
        if name is not None:
            parts.append((name, found[name][0], columns_of(found[name][0])))
    motors = next((name for name in MOTORS if name in found), None)
    if motors is not None:
        parts.append((motors, *motors_of(found[motors], motors, parameters, sentences)))
    columns: dict[str, dict[str, Array]] = {}
    for name, _, own in parts:  # one topic may hold two signals
        columns.setdefault(name, {}).update(own)
    data = {name: own for name, own, _ in parts}
    if BATTERY in data:
        data[BATTERY] = _held(data[BATTERY], columns[BATTERY], data.values())
    return {name: _log(data[name], own, path, (*said, *sentences)) for name, own in columns.items() if own}


def _log(data: Dataset, columns: Mapping[str, Array], path: Path, said: tuple[str, ...]) -> Log:
    """Raw columns at the times of the topic, s since the vehicle started."""
    signals = {name: np.asarray(values, dtype=np.float64) for name, values in columns.items()}
    t = np.asarray(data["timestamp"], dtype=np.float64) * 1e-6
    return replace(raw_log(signals, path.name, said), t=t)


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
    # the same attitude has two signs: neighbours are to have the same, since they are interpolated
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
    """Without a power module PX4 writes 0 V and -1 A, which nobody measured."""
    own = {"voltage_v": "battery_voltage [V]", "current_a": "battery_current [A]"}
    return {header: data[name] for name, header in own.items() if np.any(data.get(name, np.zeros(1)) > 0.0)}


def _held(data: Dataset, columns: dict[str, Array], others: Iterable[Dataset]) -> Dataset:
    """A topic that is sent once a second, which holds before its first row and after its last one too."""
    times = [float(one["timestamp"][k]) for one in others for k in (0, -1)]
    for name, values in columns.items():
        columns[name] = np.concatenate([values[:1], values, values[-1:]])
    return {"timestamp": np.concatenate([[min(times)], data["timestamp"], [max(times)]])}


def _speed_controllers(data: Dataset) -> dict[str, Array]:
    """What each reports; asides of a flight."""
    own = {"esc_rpm": "esc_rpm_{}", "esc_current": "esc_current_{} [A]"}
    return {
        header.format(i + 1): data[f"esc[{i}].{name}"]
        for name, header in own.items()
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
"""Topics, of which the first that is there is read, and the columns in it."""

read_ulog = UlogReader()
