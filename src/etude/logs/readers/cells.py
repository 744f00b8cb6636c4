"""Cells of a table's columns as numbers, as text, and as lists of either."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np

from etude.logs.readers.clock_texts import nanoseconds
from etude.types import Array

if TYPE_CHECKING:
    import polars as pl

LONGEST = 1000  # entries of a list: longer ones are images and scans
SCALAR = re.compile(r"^(?:np|numpy)\.\w+\(|\)$")  # as numpy writes a number in a list, np.float64(0.1)
LIST = re.compile(r"\s*(?:array\(\s*'?\w'?,\s*)?[\[(](.*?)[\])]+\s*")  # (0.1, 0.2), array('d', [0.1, 0.2])


def numbers_of(series: pl.Series) -> Array:
    """(T,) the cells as numbers: stamps and dates in nanoseconds, text where it is a number; NaN for all
    else.
    """
    import polars as pl

    dtype = series.dtype
    if dtype in (pl.Categorical, pl.Enum, pl.Binary):
        series = _text(series)
        dtype = series.dtype
    if dtype == pl.String:
        series = series.str.strip_chars()
    elif dtype == pl.Datetime:
        series = series.cast(pl.Datetime("ns"), strict=False).dt.timestamp("ns")
    elif dtype == pl.Duration:
        series = series.dt.total_nanoseconds()
    elif not (dtype.is_numeric() or dtype in (pl.Boolean, pl.Time)):
        return np.full(len(series), np.nan)
    values = series.cast(pl.Float64, strict=False).fill_null(float("nan")).to_numpy()
    told = nanoseconds(series.to_list()) if dtype == pl.String and not np.isfinite(values).any() else None
    if told is not None:
        return told
    return np.array(values, dtype=np.float64)


def _text(series: pl.Series) -> pl.Series:
    """Categories and bytes as text; bytes that are none are empty."""
    import polars as pl

    if series.dtype != pl.Binary:
        return series.cast(pl.String)
    cells = [None if cell is None else cell.decode(errors="replace") for cell in series.to_list()]
    return pl.Series(series.name, cells, dtype=pl.String)


def is_list(series: pl.Series) -> bool:
    """Whether its cells are lists, or text such as `[0.1, 0.2]`."""
    import polars as pl

    if isinstance(series.dtype, pl.List | pl.Array):
        return True
    first = "" if series.dtype != pl.String else next((c for c in series.head(100).to_list() if c), "")
    return LIST.fullmatch(first) is not None


def lists_of(series: pl.Series) -> list[Any]:
    """The cells of a column of lists (`is_list`); None for those of lists within lists."""
    import polars as pl

    if isinstance(series.dtype, pl.List | pl.Array):
        inner = series.dtype.inner
        nested = isinstance(inner, pl.List | pl.Array | pl.Struct)
        return [None] * len(series) if nested else series.to_list()
    return [None if cell is None else _split(cell) for cell in series.to_list()]


def rectangle(series: pl.Series) -> Array | None:
    """(T, n) of a column of lists of n numbers each, without a Python object for each; None for any other."""
    import polars as pl

    if not isinstance(series.dtype, pl.List | pl.Array) or not series.dtype.inner.is_numeric():
        return None
    series = series.arr.to_list() if isinstance(series.dtype, pl.Array) else series
    lengths = series.list.len()
    width = lengths.min()
    if series.null_count() or not width or width != lengths.max():
        return None
    flat = series.explode().cast(pl.Float64).fill_null(float("nan")).to_numpy()
    return np.array(flat, dtype=np.float64).reshape(len(series), -1)[:, :LONGEST]


def _split(cell: str) -> list[str]:
    found = LIST.fullmatch(cell)
    inner = found[1] if found is not None else cell.strip().strip("[]()")
    return [SCALAR.sub("", part.strip()).strip("'\"") for part in re.split(r"[,;\s]+", inner) if part.strip()]


def matrix(cells: list[Any], kind: type) -> Any:
    """(T, n) of lists of any length: n is the longest, what is missing is NaN, or empty text."""
    width = min(max((len(cell) for cell in cells if cell is not None), default=0), LONGEST)
    out = np.full(
        (len(cells), width), np.nan if kind is float else "", dtype=float if kind is float else object
    )
    for row, cell in enumerate(cells):
        for i, value in enumerate((cell or ())[:width]):
            out[row, i] = _number(value) if kind is float else str(value or "").strip()
    return out


def _number(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        return float("nan")


def is_text(series: pl.Series) -> bool:
    import polars as pl

    if series.dtype in (pl.Categorical, pl.Enum):
        return True
    if series.dtype != pl.String:
        return False
    return any(cell and np.isnan(_number(cell)) for cell in series.head(20).to_list())


def texts_of(series: pl.Series) -> Any:
    import polars as pl

    cells = series.cast(pl.String).fill_null("").str.strip_chars().to_list()
    out = np.empty(len(cells), dtype=object)
    out[:] = cells
    return out
