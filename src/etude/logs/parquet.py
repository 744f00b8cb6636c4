"""Cleaned logs as Parquet files that read back exactly: `t`, then `q_elbow`, `tau_elbow`, ... per axis."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError
from etude.logs.log import RobotLog
from etude.storage import write_atomic

if TYPE_CHECKING:
    import polars as pl

Array = NDArray[np.float64]
CHANNELS = ("q", "tau", "qd", "qdd", "q_des", "qd_des", "qdd_des", "tau_ff", "tau_fb", "q_true")
METADATA_KEY = "etude.log"


def parquet_bytes(log: RobotLog) -> bytes:
    """The log as the bytes of a Parquet file; names, unit, source and repairs are in its metadata."""
    import polars as pl

    columns = {"t": log.t}
    for channel in CHANNELS:
        values = getattr(log, channel)
        if values is not None:
            columns |= {f"{channel}_{name}": values[:, j] for j, name in enumerate(log.names)}
    facts = {
        "names": log.names,
        "command_unit": log.command_unit,
        "source": log.source,
        "repairs": log.repairs,
    }
    buffer = io.BytesIO()
    pl.DataFrame(columns).write_parquet(buffer, metadata={METADATA_KEY: json.dumps(facts)})
    return buffer.getvalue()


def write_parquet(log: RobotLog, path: Path) -> None:
    """Writes the log atomically; `read_parquet` gives back an equal one."""
    write_atomic(path, parquet_bytes(log))


def is_cleaned(path: Path, key: str = METADATA_KEY) -> bool:
    """Whether the file is a Parquet file with that key in its metadata; False for anything else."""
    import polars as pl

    try:
        return key in pl.read_parquet_metadata(path)
    except (OSError, pl.exceptions.PolarsError):
        return False


def read_cleaned(path: Path, key: str, what: str) -> tuple[pl.DataFrame, dict[str, Any]]:
    """The columns and the facts under `key` of a cleaned file; `what` it should be is for the message.

    Raises:
        DataError: the file is missing, truncated, no Parquet file, or has no such key.
    """
    import polars as pl

    try:
        metadata = pl.read_parquet_metadata(path)
        frame = pl.read_parquet(path)
    except (OSError, pl.exceptions.PolarsError) as problem:
        raise DataError(
            f"the file cannot be read as Parquet ({problem})",
            where=str(path),
            next_step="It is missing, truncated or another kind of file; export or tell it again.",
        ) from None
    if key not in metadata:
        raise DataError(
            f"this Parquet file is not a cleaned {what}", where=str(path), next_step="Tell it first."
        )
    return frame, json.loads(metadata[key])


def read_parquet(path: Path) -> RobotLog:
    """The log that `write_parquet` stored.

    Raises:
        DataError: the file is missing, truncated, no Parquet file, or not written by `write_parquet`.
    """
    frame, facts = read_cleaned(path, METADATA_KEY, "log")
    names = tuple(facts["names"])

    def channel(label: str) -> Array | None:
        keys = [f"{label}_{name}" for name in names]
        return frame.select(keys).to_numpy() if keys[0] in frame.columns else None

    optional = {label: channel(label) for label in CHANNELS[2:]}
    q, tau = channel("q"), channel("tau")
    if q is None or tau is None:
        raise DataError("this cleaned log has no q or tau columns", where=str(path))
    return RobotLog(
        names=names,
        command_unit=facts["command_unit"],
        t=frame["t"].to_numpy(),
        q=np.ascontiguousarray(q),
        tau=np.ascontiguousarray(tau),
        **{k: None if v is None else np.ascontiguousarray(v) for k, v in optional.items()},
        source=facts["source"],
        repairs=tuple(facts["repairs"]),
    )
