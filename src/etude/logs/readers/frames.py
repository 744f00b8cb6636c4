"""Tables as raw logs: a channel for each column, of numbers, with whatever went wrong in polars as one error.

Text is read as numbers where it is one, else NaN. Lists, and columns that are numbered like `position[0]`,
take the names beside them (`name`, `name[0]`), row by row: the order of joints may be any.
"""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from etude.errors import DataError
from etude.logs.columns.named_arrays import named_columns
from etude.logs.readers.cells import numbers_of
from etude.logs.readers.parquet_shape import check_shape
from etude.logs.readers.pointers import check_whole
from etude.logs.readers.unpacking import Room
from etude.types import Array, Channel, Log

if TYPE_CHECKING:
    import polars as pl

T = TypeVar("T")
DEEPEST = 8  # structs within structs
TEXTS = 2  # how often a column of text is held while it is read as numbers


def raw_log(columns: Mapping[str, Array], source: str, repairs: tuple[str, ...] = ()) -> Log:
    """A log of a channel for each column (T,), nothing matched or converted; its times are row numbers."""
    rows = len(next(iter(columns.values()), []))
    return Log(
        t=np.arange(rows, dtype=np.float64),
        channels={name: Channel(name, ("",), ("",), "aside") for name in columns},
        values={name: values[:, None] for name, values in columns.items()},
        source=source,
        repairs=repairs,
    )


def frame_log(frame: pl.DataFrame, path: Path, repairs: tuple[str, ...] = ()) -> Log:
    """All columns of a table as numbers; see the module.

    Raises:
        DataError: a joint's name stands twice in a row.
    """
    columns = {s.name: s for s in guarded(partial(_flat, frame), path, "a table").iter_columns()}
    named, used, sentences = guarded(lambda: named_columns(columns, str(path)), path, "a table")
    del frame
    # a column leaves the table as it becomes numbers: both at once would take twice the room
    numbers = {name: numbers_of(columns.pop(name)) for name in list(columns) if name not in used}
    clash = next((name for name in named if name in numbers), None)
    if clash is not None:
        raise DataError(
            f"column '{clash}' appears twice, once among lists",
            where=str(path),
            next_step="Remove one of them.",
        )
    return raw_log({**numbers, **named}, path.name, (*repairs, *sentences))


def parquet_frame(path: Path) -> pl.DataFrame:
    """All columns of a Parquet file. DataError: missing, truncated, or not Parquet."""
    import polars as pl

    frame = _from_parquet(path, pl.read_parquet)
    guarded(lambda: _count_text(frame, Room(path)), path, "Parquet")
    return frame


def _count_text(frame: pl.DataFrame, room: Room) -> None:
    """Text that repeats stands in the file once, and in memory too until it is looked at."""
    import polars as pl

    for series in frame.iter_columns():
        if series.dtype in (pl.String, pl.Categorical, pl.Enum):
            size = int(series.cast(pl.String).str.len_bytes().sum() or 0)
            room.take(size)
            room.require(TEXTS * size)


def parquet_metadata(path: Path) -> Mapping[str, str]:
    """The file's own key-value metadata. DataError: missing, truncated, or not Parquet."""
    import polars as pl

    return _from_parquet(path, pl.read_parquet_metadata)


def _from_parquet(path: Path, read: Callable[[io.BytesIO], T]) -> T:
    def checked() -> T:
        data = path.read_bytes()
        check_whole(data, path)
        check_shape(data, Room(path))
        with without_panics_on_screen():
            return read(io.BytesIO(data))

    return guarded(checked, path, "Parquet")


@contextlib.contextmanager
def without_panics_on_screen() -> Iterator[None]:
    """Sends what compiled code writes to standard error nowhere: a panic there is told as an error here."""
    try:
        kept = os.dup(2)
    except OSError:  # there is no standard error
        yield
        return
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
            yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def guarded(action: Callable[[], T], path: Path, format_: str) -> T:
    """What `action` gives; whatever goes wrong in polars is a DataError with the reason's first line.

    A panic in its Rust code is no `Exception`: it is known by its name, since its class is not public.
    """
    import polars as pl

    try:
        return action()
    except (OSError, ValueError, TypeError, LookupError, MemoryError, pl.exceptions.PolarsError) as problem:
        reason: BaseException = problem
    except BaseException as problem:
        if type(problem).__name__ != "PanicException":
            raise
        reason = problem
    first = (str(reason).strip().splitlines() or [type(reason).__name__])[0][:200]
    raise DataError(
        f"the file cannot be read as {format_} ({first})",
        where=str(path),
        next_step="It is truncated or another kind of file; export the log again.",
    ) from None


def _flat(frame: pl.DataFrame) -> pl.DataFrame:
    """The table with the fields of its structs as columns, `state.position`."""
    import polars as pl

    for _ in range(DEEPEST):
        nested = [name for name, dtype in frame.schema.items() if isinstance(dtype, pl.Struct)]
        if not nested:
            break
        for name in nested:
            fields = frame[name].struct.unnest()
            fields.columns = [f"{name}.{field}" for field in fields.columns]
            frame = frame.drop(name).hstack(fields)
    return frame
