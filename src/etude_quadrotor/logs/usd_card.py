"""Logs of the Crazyflie's micro-SD card deck as raw logs, in the frames and units of Étude.

The format is that of the firmware's decoder (github.com/bitcraze/crazyflie-firmware, tools/usdlog): a byte
0xBC, the version, the kinds of events with names and types of their variables, then events: a number, a
time, and the variables, little-endian and packed; at the end a CRC-32 of all that.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from etude.errors import DataError
from etude.logs.readers.frames import raw_log
from etude.types import Array, Log

MAGIC = 0xBC  # first byte of a file of the Crazyflie's SD card deck
TIMES = {1: ("<HI", 1e-3), 2: ("<HQ", 1e-6)}
"""Version -> how number and time of an event are written, and the time's unit in s."""
TYPES = "bBhHiIqQfd"
MOST = 1000
"""Largest number of kinds of events, and of variables of one kind."""
FULL = 65535.0
"""A set-point of a motor at full scale."""
AXES = ("x", "y", "z")
# variable -> header with its unit, factor; the firmware's pitch is positive upwards, against its own axes
HEADERS: Mapping[str, tuple[str, float]] = {
    **{f"acc.{a}": (f"acc_{a} [g]", 1.0) for a in AXES},
    **{f"gyro.{a}": (f"gyro_{a} [deg/s]", 1.0) for a in AXES},
    **{f"motor.m{i}": (f"motor_{i}", 1.0 / FULL) for i in range(1, 5)},
    **{f"pwm.m{i}_pwm": (f"motor_{i}", 1.0 / FULL) for i in range(1, 5)},
    **{f"stateEstimate.{a}": (f"position_{a} [m]", 1.0) for a in AXES},
    **{f"stateEstimate.v{a}": (f"velocity_{a} [m/s]", 1.0) for a in AXES},
    **{f"stateEstimate.q{a}": (f"quat_{a}", 1.0) for a in ("w", *AXES)},
    **{f"stateEstimateZ.{a}": (f"position_{a} [mm]", 1.0) for a in AXES},
    **{f"stateEstimateZ.v{a}": (f"velocity_{a} [mm/s]", 1.0) for a in AXES},
    "stateEstimate.roll": ("attitude_roll [deg]", 1.0),
    "stateEstimate.pitch": ("attitude_pitch [deg]", -1.0),
    "stateEstimate.yaw": ("attitude_yaw [deg]", 1.0),
    "stabilizer.roll": ("attitude_roll [deg]", 1.0),
    "stabilizer.pitch": ("attitude_pitch [deg]", -1.0),
    "stabilizer.yaw": ("attitude_yaw [deg]", 1.0),
    "pm.vbat": ("battery_voltage [V]", 1.0),
}


@dataclass
class _Event:
    """One kind of events: its variables, and the rows of it that were found."""

    name: str
    variables: tuple[str, ...]
    packed: struct.Struct
    times: list[int] = field(default_factory=list)
    rows: list[tuple[float, ...]] = field(default_factory=list)


class UsdCardReader:
    """A `protocols.Reader` of the deck's logs."""

    def __call__(self, path: Path, topics: Sequence[str] = ()) -> Mapping[str, Log]:
        """A log for each kind of events with data of the flight, or for each requested kind.

        Raises:
            DataError: another kind of file, or no such events.
        """
        data = path.read_bytes()
        try:
            events, cut = _decoded(data)
        except (struct.error, IndexError, ValueError, UnicodeDecodeError) as problem:
            raise DataError(
                f"the file cannot be read as a log of the Crazyflie's card ({problem})",
                where=str(path),
                next_step="Copy it from the card again.",
            ) from None
        recorded = {event.name: event for event in events if event.rows and event.variables}
        missing = [topic for topic in topics if topic not in recorded]
        if missing or not recorded:
            raise DataError(
                f"the log has no events {', '.join(missing)}" if missing else "the log holds no events",
                where=str(path),
                next_step=f"It has {', '.join(recorded) or 'none'}.",
            )
        version = int.from_bytes(data[1:3], "little")
        flight_kinds = [n for n, event in recorded.items() if set(event.variables) & set(HEADERS)]
        return {
            n: _log(recorded[n], TIMES[version][1], path, cut) for n in topics or flight_kinds or recorded
        }

    def recognises(self, path: Path, head: bytes) -> bool:  # noqa: ARG002
        """Whether the file is such a log, by its first bytes: the card's files have no suffix."""
        return len(head) > 5 and head[0] == MAGIC and int.from_bytes(head[1:3], "little") in TIMES


def _decoded(data: bytes) -> tuple[list[_Event], tuple[str, ...]]:
    """The events, and a sentence if the end is missing. ValueError and others: no such log."""
    if len(data) < 5 or data[0] != MAGIC:
        raise ValueError("it does not begin as one")
    version, kinds = struct.unpack_from("<HH", data, 1)
    if version not in TIMES or kinds > MOST:
        raise ValueError(f"version {version} is not known")
    whole = len(data) >= 9 and zlib.crc32(data[:-4]) == int.from_bytes(data[-4:], "little")
    events, place = {}, 5
    for _ in range(kinds):
        number, event, place = _kind(data, place)
        events[number] = event
    _read(data[: len(data) - 4 if whole else len(data)], place, struct.Struct(TIMES[version][0]), events)
    note = "The checksum does not fit: the log was cut or is damaged; what could be read was."
    return list(events.values()), () if whole else (note,)


def _kind(data: bytes, place: int) -> tuple[int, _Event, int]:
    """Number and description of one kind of events, and the place behind it."""
    (number,) = struct.unpack_from("<H", data, place)
    name, place = _text(data, place + 2)
    (count,) = struct.unpack_from("<H", data, place)
    if count > MOST:
        raise ValueError(f"events of {count} variables")
    variables, types, place = [], "<", place + 2
    for _ in range(count):
        text, place = _text(data, place)
        variable, _, kind = text.rpartition("(")
        if len(kind) != 2 or kind[0] not in TYPES:
            raise ValueError(f"the variable {text[:40]!r} is of no known type")
        variables.append(variable)
        types += kind[0]
    return number, _Event(name, tuple(variables), struct.Struct(types)), place


def _text(data: bytes, place: int) -> tuple[str, int]:
    # names have some 30 characters: without an end within 200 the file is damaged
    end = data.index(b"\0", place, place + 200)
    return data[place:end].decode(), end + 1


def _read(data: bytes, place: int, head: struct.Struct, events: Mapping[int, _Event]) -> None:
    """Fills the events; data after an unknown event cannot be decoded."""
    while place + head.size <= len(data):
        number, time = head.unpack_from(data, place)
        event = events.get(number)
        place += head.size
        if event is None or place + event.packed.size > len(data):
            return
        event.times.append(time)
        event.rows.append(event.packed.unpack_from(data, place))
        place += event.packed.size


def _log(event: _Event, unit: float, path: Path, notes: tuple[str, ...]) -> Log:
    values = np.array(event.rows, dtype=np.float64)
    columns: dict[str, Array] = {}
    for i, variable in enumerate(event.variables):
        header, factor = HEADERS.get(variable, (variable, 1.0))
        columns.setdefault(header, factor * values[:, i])
    times = np.array(event.times, dtype=np.float64) * unit
    return replace(raw_log(columns, path.name, notes), t=times)


read_usd_card = UsdCardReader()
