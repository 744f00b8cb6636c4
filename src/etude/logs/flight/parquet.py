"""Cleaned flights as Parquet files that read back exactly: `t`, then `rates_x`, `command_<name>`, ... ."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from etude.logs.flight.log import FlightLog
from etude.logs.parquet import is_cleaned, read_cleaned
from etude.storage import write_atomic
from etude.trajectories.flight.states import FlightStates

Array = NDArray[np.float64]
METADATA_KEY = "etude.flight"
STATES = ("specific_force", "rates", "angular_acceleration", "velocity", "acceleration")
PLACES = ("position", "position_des")


def flight_bytes(log: FlightLog) -> bytes:
    """The flight as the bytes of a Parquet file; names, unit, source and repairs are in its metadata."""
    import polars as pl

    columns: dict[str, Array] = {"t": log.t}
    if log.states.altitude is not None:
        columns["altitude"] = log.states.altitude
    vectors = {name: getattr(log.states, name) for name in STATES} | {n: getattr(log, n) for n in PLACES}
    for name, values in vectors.items():
        if values is not None:
            columns |= {f"{name}_{axis}": values[:, j] for j, axis in enumerate("xyz")}
    columns |= {f"command_{name}": log.command[:, j] for j, name in enumerate(log.command_names)}
    facts = {
        "command_names": log.command_names,
        "command_unit": log.command_unit,
        "source": log.source,
        "repairs": log.repairs,
    }
    buffer = io.BytesIO()
    frame = pl.DataFrame({name: np.ascontiguousarray(values) for name, values in columns.items()})
    frame.write_parquet(buffer, metadata={METADATA_KEY: json.dumps(facts)})
    return buffer.getvalue()


def write_flight(log: FlightLog, path: Path) -> None:
    """Writes the flight atomically; `read_flight_parquet` gives back an equal one."""
    write_atomic(path, flight_bytes(log))


def is_cleaned_flight(path: Path) -> bool:
    """Whether the file is a Parquet file written by `write_flight`; False for anything else."""
    return is_cleaned(path, METADATA_KEY)


def read_flight_parquet(path: Path) -> FlightLog:
    """The flight that `write_flight` stored.

    Raises:
        DataError: the file is missing, truncated, no Parquet file, or not written by `write_flight`.
    """
    frame, facts = read_cleaned(path, METADATA_KEY, "flight")
    columns = {name: frame[name].to_numpy() for name in frame.columns}

    def vector(name: str, parts: Any = "xyz") -> Any:
        keys = [f"{name}_{part}" for part in parts]
        return np.stack([columns[key] for key in keys], axis=1) if keys[0] in columns else None

    states = FlightStates(columns.get("altitude"), **{name: vector(name) for name in STATES})
    return FlightLog(
        t=columns["t"],
        states=states,
        command=vector("command", facts["command_names"]),
        command_names=tuple(facts["command_names"]),
        command_unit=facts["command_unit"],
        source=facts["source"],
        repairs=tuple(facts["repairs"]),
        **{name: vector(name) for name in PLACES},
    )
