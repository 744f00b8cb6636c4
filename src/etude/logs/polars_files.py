"""Parquet files through polars, whose failures of every sort become one error."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from etude.errors import DataError

if TYPE_CHECKING:
    import polars as pl

T = TypeVar("T")


def parquet_frame(path: Path) -> pl.DataFrame:
    """All columns of a Parquet file. DataError: missing, truncated, or not Parquet."""
    import polars as pl

    return guarded(lambda: pl.read_parquet(path, glob=False, hive_partitioning=False), path, "Parquet")


def parquet_metadata(path: Path) -> Mapping[str, str]:
    """The file's own key-value metadata. DataError: missing, truncated, or not Parquet."""
    import polars as pl

    return guarded(lambda: pl.read_parquet_metadata(path), path, "Parquet")


def guarded(action: Callable[[], T], path: Path, format_: str) -> T:
    """What `action` gives; whatever goes wrong in polars is a DataError with the reason's first line.

    A panic in its Rust code is no `Exception`: it is known by its name, since the class is not public.
    """
    import polars as pl

    try:
        return action()
    except (OSError, ValueError, MemoryError, pl.exceptions.PolarsError) as problem:
        reason: BaseException = problem
    except BaseException as problem:
        if type(problem).__name__ != "PanicException":
            raise
        reason = problem
    first = (str(reason).strip().splitlines() or [type(reason).__name__])[0][:200]
    raise DataError(
        f"the file cannot be read as {format_} ({first})",
        where=str(path),
        next_step="It is missing, truncated or another kind of file; export the log again.",
    ) from None
