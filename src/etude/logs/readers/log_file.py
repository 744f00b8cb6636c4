"""Logs as Parquet files that read back exactly: `t`, then `q_elbow`, `command_elbow`, ... by channel.

Files of version 0.1, of arms and of flights, are read under today's names of channels.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from etude.errors import DataError
from etude.logs.columns.headers import column_names as column_names
from etude.logs.readers.frames import parquet_frame, parquet_metadata
from etude.storage import sha256_of, write_atomic
from etude.types import Array, Channel, Log, Role

if TYPE_CHECKING:
    import polars as pl

METADATA_KEY = "etude.log"
FLIGHT_KEY = "etude.flight"  # of 0.1, whose arms' logs have METADATA_KEY, but no channels in it
AXES = ("x", "y", "z")
# of 0.1: label in the file -> channel, units per radian or metre, role
OLD_ARM: Mapping[str, tuple[str, str, Role]] = {
    "q": ("q", "rad", "state"),
    "qd": ("qd", "rad/s", "state"),
    "qdd": ("qdd", "rad/s^2", "state"),
    "tau": ("command", "", "command"),
    "q_des": ("q_des", "rad", "plan"),
    "qd_des": ("qd_des", "rad/s", "plan"),
    "qdd_des": ("qdd_des", "rad/s^2", "plan"),
    "tau_ff": ("command_ff", "", "aside"),
    "tau_fb": ("command_fb", "", "aside"),
    "q_true": ("q_true", "rad", "truth"),
}
OLD_FLIGHT: Mapping[str, tuple[str, str, Role]] = {
    "altitude": ("altitude", "m", "state"),
    "specific_force": ("specific_force", "m/s^2", "state"),
    "rates": ("rates", "rad/s", "state"),
    "angular_acceleration": ("angular_acceleration", "rad/s^2", "state"),
    "velocity": ("body_velocity", "m/s", "state"),
    "acceleration": ("body_acceleration", "m/s^2", "state"),
    "command": ("command", "", "command"),
    "position": ("position", "m", "aside"),
    "position_des": ("position_des", "m", "plan"),
}


def log_bytes(log: Log) -> bytes:
    """The log as the bytes of a Parquet file; channels, source and repairs are in its metadata.

    Raises:
        DataError: two channels would share a column.
    """
    import polars as pl

    columns: dict[str, Array] = {"t": log.t}
    for name, values in log.values.items():
        for column, part in zip(column_names(log.channels[name]), values.T, strict=True):
            if column in columns:
                raise DataError(
                    f"two signals of the log are both named '{column}'",
                    where=log.source,
                    next_step="Rename a joint or a channel.",
                )
            columns[column] = np.ascontiguousarray(part)
    facts = {
        "channels": [_facts(log.channels[name]) for name in log.values],
        "source": log.source,
        "repairs": log.repairs,
    }
    buffer = io.BytesIO()
    pl.DataFrame(columns).write_parquet(buffer, metadata={METADATA_KEY: json.dumps(facts)})
    return buffer.getvalue()


def write_log(path: Path, log: Log) -> None:
    """Writes the log atomically; `read_log_file` gives back an equal one."""
    write_atomic(Path(path), log_bytes(log))


def is_log_file(path: Path) -> bool:
    """Whether the file is a Parquet file written by `write_log`, or by 0.1; False for anything else."""
    try:
        return _key(parquet_metadata(Path(path))) is not None
    except DataError:
        return False


def read_log_file(path: Path) -> Log:
    """The log that `write_log`, or 0.1, stored.

    Raises:
        DataError: the file is missing, truncated, no Parquet file, or not written by Étude.
    """
    path = Path(path)
    facts = parquet_metadata(path)
    key = _key(facts)
    if key is None:
        raise DataError("this Parquet file is not a cleaned log", where=str(path), next_step="Tell it first.")
    frame = parquet_frame(path)
    try:
        return _log(frame, json.loads(facts[key]), key)
    except (KeyError, TypeError, ValueError, AttributeError) as problem:
        raise DataError(
            f"the columns of this cleaned log are not those that its metadata name ({problem})",
            where=str(path),
            next_step="The file was changed or damaged; take it from a copy, or tell the log again.",
        ) from None


def _key(metadata: Mapping[str, str]) -> str | None:
    return next((key for key in (METADATA_KEY, FLIGHT_KEY) if key in metadata), None)


def _log(frame: pl.DataFrame, facts: Mapping[str, Any], key: str) -> Log:
    if "channels" in facts:
        named = [(channel := _channel(row), column_names(channel)) for row in facts["channels"]]
    else:
        named = _old_channels(set(frame.columns), facts, key)
    return Log(
        t=_column(frame, "t"),
        channels={channel.name: channel for channel, _ in named},
        values={channel.name: _columns(frame, columns) for channel, columns in named},
        source=str(facts["source"]),
        repairs=tuple(str(sentence) for sentence in facts["repairs"]),
    )


def _column(frame: pl.DataFrame, name: str) -> Array:
    values = frame[name]
    if not values.dtype.is_float() or values.null_count():
        raise ValueError(f"column {name} is not of numbers")
    return np.array(values.to_numpy(), dtype=np.float64)


def _columns(frame: pl.DataFrame, names: Sequence[str]) -> Array:
    if not all(name in frame.columns for name in names):
        raise ValueError(f"no column {next(n for n in names if n not in frame.columns)}")
    return np.stack([_column(frame, name) for name in names], axis=1)


def _facts(channel: Channel) -> dict[str, Any]:
    """The fields of a channel that are not their defaults."""
    defaults = {f.name: f.default for f in fields(Channel) if f.default is not MISSING}
    return {n: v for n, v in vars(channel).items() if n not in defaults or v != defaults[n]}


def _channel(facts: Mapping[str, Any]) -> Channel:
    known = {f.name for f in fields(Channel)}
    values: Any = {n: tuple(v) if isinstance(v, list) else v for n, v in facts.items() if n in known}
    return Channel(**values)


def _old_channels(columns: set[str], facts: Mapping[str, Any], key: str) -> list[tuple[Channel, list[str]]]:
    """Channels of a file of 0.1 and their columns; those it lacks are left out, all but the commands."""
    names = tuple(facts["names"] if key == METADATA_KEY else facts["command_names"])
    needed: tuple[str, ...]
    if key == METADATA_KEY:
        rows, needed, parts = OLD_ARM, ("q", "tau"), dict.fromkeys(OLD_ARM, names)
    else:
        rows, needed = OLD_FLIGHT, ("specific_force", "rates", "command")
        parts = {**dict.fromkeys(OLD_FLIGHT, AXES), "command": names, "altitude": ("z",)}
    found = []
    for label, (name, unit, role) in rows.items():
        own = ["altitude"] if label == "altitude" else [f"{label}_{part}" for part in parts[label]]
        if own[0] in columns or label in needed:
            units = (unit or str(facts["command_unit"]),) * len(own)
            found.append((Channel(name, parts[label], units, role, required=label in needed), own))
    return found


RECORDED = (".yaml", ".db3", ".mcap", ".zstd")
"""Suffixes of the files in a folder that are part of a recording."""


def sha256_of_log(path: Path) -> str:
    """Of a file its own SHA-256; of a folder that of the names and hashes of the files recorded in it.

    Raises:
        DataError: there is no such log, or it may not be read.
    """
    try:
        if path.is_file():
            return sha256_of(path)
        if path.is_dir():
            text = "".join(f"{sha256_of(one)} {one.name}\n" for one in _recorded(path))
            return hashlib.sha256(text.encode()).hexdigest()
    except (OSError, ValueError) as error:
        raise DataError(
            f"the log file cannot be read: {getattr(error, 'strerror', None) or error}",
            where=str(path),
            next_step="Check that you may read it.",
        ) from None
    raise DataError("there is no such log file", where=str(path), next_step="Check the path.")


def bytes_of_log(path: Path) -> int:
    """Of a file its size; of a folder that of the files recorded in it."""
    return sum(one.stat().st_size for one in ([path] if path.is_file() else _recorded(path)))


def _recorded(folder: Path) -> list[Path]:
    return sorted(one for one in folder.iterdir() if one.suffix in RECORDED and one.is_file())
