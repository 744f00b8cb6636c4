"""Cells of a table's columns as numbers, as times, as text, and as lists of these."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from etude.types import Array

if TYPE_CHECKING:
    import polars as pl

LONGEST = 1000  # entries of a list: longer ones are images and scans
SCALAR = re.compile(r"^(?:np|numpy)\.\w+\(|\)$")  # as numpy writes a number in a list, np.float64(0.1)
LIST = re.compile(r"\s*(?:array\(\s*'?\w'?,\s*)?[\[(](.*?)[\])]+\s*")  # (0.1, 0.2), array('d', [0.1, 0.2])


MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_CLOCK = r"(?P<h>\d\d?):?(?P<min>\d\d):?(?P<s>\d\d(?:[.,:]\d{1,9})?)(?: ?(?P<half>[AaPp])\.?[Mm]\.?)?"
_ZONE = r" ?(?:Z|UTC|[+-]\d\d:?\d\d)?"
ISO = re.compile(rf"(?P<y>\d{{4}})([-/.]?)(?P<m>\d\d)\2(?P<d>\d\d)[T _]{_CLOCK}{_ZONE}")
MATLAB = re.compile(rf"(?P<d>\d\d)[- ](?P<m>[A-Za-z]{{3}})[- ](?P<y>\d{{4}}) {_CLOCK}{_ZONE}")
DAY_FIRST = re.compile(rf"(?P<d>\d\d?)\.(?P<m>\d\d?)\.(?P<y>\d{{4}}),? {_CLOCK}")
# 5/6/2024 is ambiguous, and only differences count: the first number is the month if it can be one
SLASHES = re.compile(rf"(?P<m>\d\d?)/(?P<d>\d\d?)/(?P<y>\d{{4}}),? {_CLOCK}")
DURATION = re.compile(r"(?:(\d+) days?,? )?(\d+):(\d\d):(\d\d(?:[.,:]\d+)?)")
MINUTES = re.compile(r"(\d\d):(\d\d[.,]\d+)")
HALVES = re.compile(r"(?P<h>\d\d?):(?P<min>\d\d):(?P<s>\d\d(?:[.,:]\d+)?) ?(?P<half>[AaPp])\.?[Mm]\.?")
MEASURED = re.compile(r"(\d+(?:\.\d*)?(?:[eE][-+]?\d+)?) (sec|seconds|s|ms|min|hr)")
SECONDS = {"sec": 1.0, "seconds": 1.0, "s": 1.0, "ms": 1e-3, "min": 60.0, "hr": 3600.0}
GIGA = 1e9  # ns in a second


def nanoseconds(cells: Sequence[str | None]) -> Array | None:
    """(T,) ns of cells that are times, a time zone left out; NaN of a cell that is none. None if the first
    cell that says something is no time.

    Dates count from 1970, durations (`0 days 00:00:01.5`, `00:00:01.5`, `1.5 sec`) from zero, as pandas and
    MATLAB write both; a clock without a date (`12:30:05,250`, `01:30:05.25 PM`, `30:05.250`) is a duration.
    """
    first = next((cell for cell in cells[:100] if cell), "")
    form = next(((pattern, read) for pattern, read in FORMS if pattern.fullmatch(first)), None)
    if form is None:
        return None
    pattern, read = form
    return np.array([_read(pattern.fullmatch(cell or ""), read) for cell in cells], dtype=np.float64)


def _read(match: re.Match[str] | None, read: Callable[[re.Match[str]], float]) -> float:
    if match is None:
        return float("nan")
    try:
        return read(match)
    except ValueError:  # the 31st of June
        return float("nan")


def _date(match: re.Match[str]) -> float:
    month, day = match["m"], int(match["d"])
    number = int(month) if month.isdigit() else MONTHS.index(month.lower()) + 1
    if number > 12 >= day:
        number, day = day, number
    at = np.datetime64(f"{match['y']}-{number:02d}-{day:02d}", "ns").astype(np.int64)
    return float(at) + _clock(match)


def _clock(match: re.Match[str]) -> float:
    """ns since midnight of `h`, `min`, `s` and `half`, a.m. or p.m."""
    hours = int(match["h"])
    if match["half"]:
        hours = hours % 12 + 12 * (match["half"].lower() == "p")
    if hours > 23 or int(match["min"]) > 59 or _seconds(match["s"]) > 61.0:  # a leap second is a time
        raise ValueError(f"not a time of day: {match[0]}")
    return GIGA * ((hours * 60.0 + int(match["min"])) * 60.0 + _seconds(match["s"]))


def _seconds(text: str) -> float:
    """Of 05.25, 05,25 and 05:250."""
    return float(text.replace(",", ".").replace(":", "."))


def _duration(match: re.Match[str]) -> float:
    days, hours, minutes = (int(part or 0) for part in match.groups()[:3])
    return GIGA * (((24.0 * days + hours) * 60.0 + minutes) * 60.0 + _seconds(match[4]))


def _minutes(match: re.Match[str]) -> float:
    return GIGA * (60.0 * int(match[1]) + _seconds(match[2]))


def _measured(match: re.Match[str]) -> float:
    return GIGA * SECONDS[match[2]] * float(match[1])


FORMS = (
    *((form, _date) for form in (ISO, MATLAB, DAY_FIRST, SLASHES)),
    *((HALVES, _clock), (DURATION, _duration), (MINUTES, _minutes), (MEASURED, _measured)),
)


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
    parsed = nanoseconds(series.to_list()) if dtype == pl.String and not np.isfinite(values).any() else None
    if parsed is not None:
        return parsed
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
    match = LIST.fullmatch(cell)
    inner = match[1] if match is not None else cell.strip().strip("[]()")
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


FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""How a formula begins, as OWASP lists it under "CSV Injection"."""
AS_TEXT = "'"
"""Before a cell it says that what follows is text."""
SEPARATING = ",;|'\"\t "


def text_cell(text: str) -> str:
    """A cell of CSV that `restored`, or any reader of quoted cells, gives back."""
    escaped = AS_TEXT + text if text.startswith((*FORMULA, AS_TEXT)) else text
    return '"{}"'.format(escaped.replace('"', '""')) if any(c in escaped for c in SEPARATING) else escaped


def header_row(names: Iterable[str]) -> str:
    """A line of names."""
    return ",".join(map(text_cell, names)) + "\n"


def restored(text: str) -> str:
    """The name that `text_cell` wrote, of a cell without its quotes."""
    begins = text.startswith(AS_TEXT) and text[1:].startswith((*FORMULA, AS_TEXT))
    return text[1:] if begins else text
