"""Logs as Parquet files that read back exactly: `t`, then `q_elbow`, `command_elbow`, ... by channel."""

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
from etude.logs.readers.frames import parquet_metadata, parquet_table
from etude.storage import sha256_of, write_atomic
from etude.types import Array, Channel, Log

if TYPE_CHECKING:
    import polars as pl

METADATA_KEY = "etude.log"


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
    """Whether the file is a Parquet file written by `write_log`; False for anything else."""
    try:
        return METADATA_KEY in parquet_metadata(Path(path))
    except DataError:
        return False


def read_log_file(path: Path) -> Log:
    """The log that `write_log` stored.

    Raises:
        DataError: the file is missing, truncated, no Parquet file, or not written by Étude.
    """
    path = Path(path)
    frame, facts = parquet_table(path)
    if METADATA_KEY not in facts:
        raise DataError("this Parquet file is not a cleaned log", where=str(path), next_step="Tell it first.")
    try:
        return _log(frame, json.loads(facts[METADATA_KEY]))
    except (KeyError, TypeError, ValueError, AttributeError) as problem:
        raise DataError(
            f"the columns of this cleaned log differ from its metadata ({problem})",
            where=str(path),
            next_step="The file was changed or damaged; restore it from a copy, or ingest the log again.",
        ) from None


def _log(frame: pl.DataFrame, facts: Mapping[str, Any]) -> Log:
    named = [(channel := _channel(row), column_names(channel)) for row in facts["channels"]]
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
        raise ValueError(f"column {name} does not hold numbers")
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
    names = {f.name for f in fields(Channel)}
    values: Any = {n: tuple(v) if isinstance(v, list) else v for n, v in facts.items() if n in names}
    return Channel(**values)


RECORDED = (".yaml", ".db3", ".mcap", ".zstd")
"""Suffixes of the files in a folder that are part of a recording."""


def sha256_of_log(path: Path) -> str:
    """SHA-256 of a file; of a folder, that of the names and hashes of the files recorded in it.

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
    """Size of a file, or of the files recorded in a folder, in bytes."""
    return sum(one.stat().st_size for one in ([path] if path.is_file() else _recorded(path)))


def _recorded(folder: Path) -> list[Path]:
    return sorted(one for one in folder.iterdir() if one.suffix in RECORDED and one.is_file())
