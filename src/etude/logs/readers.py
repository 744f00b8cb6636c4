"""Raw tables: what a reader makes of a file, before anything is matched, converted or repaired."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError

if TYPE_CHECKING:
    import polars as pl

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Table:
    """The columns of a file by header, all of one length; unreadable cells are NaN.

    Attributes:
        columns: header -> (T,) values.
        repairs: sentences on what was dropped while reading.
    """

    columns: dict[str, Array]
    repairs: tuple[str, ...] = ()


Reader = Callable[[Path], Table]


def read_table(path: Path) -> Table:
    """The file's raw columns, by the reader of its suffix.

    Raises:
        DataError: no such file, unknown kind, empty, truncated, or not what its suffix says.
    """
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise DataError(
            f"there is no reader for '{path.suffix}' files",
            where=str(path),
            next_step=f"Convert the log to one of: {', '.join(READERS)}.",
        )
    if not path.is_file():
        raise DataError("there is no such log file", where=str(path), next_step="Check the path.")
    if path.stat().st_size == 0:
        raise DataError("the log file is empty (0 bytes)", where=str(path), next_step="Export the log again.")
    table = reader(path)
    rows = len(next(iter(table.columns.values()), []))
    if rows < 2:
        raise DataError(
            f"the log file has {rows} rows of data", where=str(path), next_step="Export the log again."
        )
    return table


def read_csv(path: Path) -> Table:
    """Comma, semicolon or tab separated text with one header row; lines that start with # are skipped."""
    import polars as pl

    text, repairs = _csv_text(path)
    header = next((line for line in text.split("\n") if line.strip() and not line.startswith("#")), "")
    separator = max(",;\t", key=header.count)
    names = [name.strip().strip('"') for name in header.split(separator)]
    if all(_is_number(name) for name in names):
        raise DataError(
            "the first line has numbers where the column names should be",
            where=str(path),
            next_step="Add a header row such as t,q_<joint>,tau_<joint>.",
        )
    double = sorted({name for name in names if names.count(name) > 1})
    if double:
        raise DataError(
            f"column '{double[0]}' appears twice", where=str(path), next_step="Remove one of them."
        )
    try:
        frame = pl.read_csv(
            text.encode(),
            separator=separator,
            comment_prefix="#",
            infer_schema=False,
            truncate_ragged_lines=True,
        )
    except pl.exceptions.PolarsError as problem:
        raise DataError(
            f"the file cannot be read as CSV ({problem})", where=str(path), next_step="Export the log again."
        ) from None
    return Table(_numbers(frame, names), repairs)


def _csv_text(path: Path) -> tuple[str, tuple[str, ...]]:
    data = path.read_bytes()
    if data[:4] == b"PAR1":
        raise DataError("this is a Parquet file", where=str(path), next_step="Rename it to .parquet.")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise DataError(
            "this is a binary file, not CSV text",
            where=str(path),
            next_step="Export the log as CSV or Parquet.",
        )
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    if not text.strip():
        raise DataError("the log file is blank", where=str(path), next_step="Export the log again.")
    if text.endswith("\n"):
        return text, ()
    # A line without its end may have lost part of its last number; nothing in it can be trusted.
    complete = text[: text.rfind("\n") + 1]
    if not complete.strip():
        raise DataError(
            "the log file has no complete line", where=str(path), next_step="Export the log again."
        )
    return complete, ("The last line has no end (a cut file?) and was dropped.",)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def read_parquet_table(path: Path) -> Table:
    """All numeric columns of a Parquet file."""
    import polars as pl

    try:
        frame = pl.read_parquet(path)
    except (OSError, pl.exceptions.PolarsError) as problem:
        reason = str(problem).split("\n")[0]
        raise DataError(
            f"the file cannot be read as Parquet ({reason})",
            where=str(path),
            next_step="It is truncated or another kind of file; export the log again.",
        ) from None
    return Table(_numbers(frame, frame.columns))


def _numbers(frame: pl.DataFrame, names: list[str]) -> dict[str, Array]:
    """Columns that hold at least one number; text cells and empty cells become NaN."""
    import polars as pl

    columns = {}
    for name, series in zip(names, frame.iter_columns(), strict=True):
        if series.dtype == pl.String:
            series = series.str.strip_chars()
        if series.dtype.is_temporal():
            series = (
                series.cast(pl.Datetime("ns")).dt.timestamp("ns") if series.dtype == pl.Datetime else series
            )
        values = series.cast(pl.Float64, strict=False).fill_null(float("nan")).to_numpy()
        columns[name] = np.array(values, dtype=np.float64)
    return columns


READERS: dict[str, Reader] = {
    ".csv": read_csv,
    ".tsv": read_csv,
    ".txt": read_csv,
    ".parquet": read_parquet_table,
}
