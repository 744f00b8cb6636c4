"""The file of one run's result: a table, the run itself, and where it comes from."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from etude.errors import DataError
from etude.logs import parquet_frame, parquet_metadata
from etude.storage import write_atomic
from etude_studies.made import Made

if TYPE_CHECKING:
    import polars as pl

    from etude_studies.spec import Spec

FORMAT = "1"
"""Of the files; a result of another format is computed again."""


def result_path(folder: Path, spec: Spec) -> Path:
    """Where a run's result is kept in a store."""
    return Path(folder) / f"{spec.hash}.parquet"


def write_result(path: Path, table: pl.DataFrame, spec: Spec, made: Made) -> None:
    """Writes a result, whole or not at all. EtudeError: the disk is full or refuses."""
    metadata = {
        "format": FORMAT,
        "hash": spec.hash,
        "spec": spec.canonical(),
        "made": json.dumps(made._asdict(), sort_keys=True),
    }
    write_atomic(path, parquet_bytes(table, metadata))


def parquet_bytes(table: pl.DataFrame, metadata: dict[str, str]) -> bytes:
    """The table as a Parquet file with its own metadata."""
    data = io.BytesIO()
    table.write_parquet(data, compression="zstd", compression_level=12, metadata=metadata)
    return data.getvalue()


def read_result(path: Path, spec: Spec) -> pl.DataFrame:
    """The table of a run's result.

    Raises:
        DataError: it is missing, truncated, of another run, or of another format.
    """
    read_metadata(path, "hash", spec.hash)
    return parquet_frame(path)


def read_made(path: Path) -> Made:
    """Where a result comes from. DataError as `read_result`."""
    metadata = read_metadata(path)
    return Made(**json.loads(metadata["made"]))


def read_metadata(path: Path, key: str = "", expected: str = "") -> Mapping[str, str]:
    """What stands beside the table. DataError: damaged, of another format, or `key` is not as expected."""
    metadata = parquet_metadata(path)
    if metadata.get("format") != FORMAT:
        raise _unfit(f"it is a result of format {metadata.get('format', 'unknown')}, not {FORMAT}", path)
    if key and metadata.get(key) != expected:
        raise _unfit(f"it is of another run: {metadata.get(key)}, not {expected}", path)
    return metadata


def _unfit(fact: str, path: Path) -> DataError:
    return DataError(fact, where=str(path), next_step="Delete it; the run is then computed again.")
