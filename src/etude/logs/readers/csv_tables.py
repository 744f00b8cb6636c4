"""Tables in text as raw logs, block by block: separators, decimal commas, headers, and columns of text.

What a column holds is judged by the beginning of the file: numbers are read as such, block by block, so that
a long log never stands in memory as text. Cells of a column of numbers that are none are NaN.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from etude.errors import DataError
from etude.logs.readers.cells import numbers_of
from etude.logs.readers.csv_header import AGAIN, header_of
from etude.logs.readers.frames import frame_log, guarded, raw_log
from etude.logs.readers.text_blocks import TextBlocks
from etude.types import Array, Log

if TYPE_CHECKING:
    import polars as pl

JUDGED = 1000
"""Rows by which a column's type is judged."""
DECIMAL_COMMA = re.compile(r"(?:^|[;\t| ])\s*-?\d*,\d+(?:[eE][-+]?\d+)?\s*(?=[;\t| ]|$)", re.MULTILINE)


@dataclass(frozen=True)
class _Form:
    """How the table is written, and which of its columns hold numbers."""

    names: tuple[str, ...]
    separator: str
    decimal_comma: bool
    numeric: tuple[bool, ...] = ()


def csv_log(path: Path) -> Log:
    """The raw columns of comma, semicolon or tab separated text; lines that start with # are skipped,
    and Excel's `sep=;`.

    Raises:
        DataError: not text, blank, without a header or with a broken one.
    """
    blocks = TextBlocks(path)
    rest = iter(blocks)
    first = next((block for block in rest if block.strip()), b"")
    if not first:
        raise DataError(_nothing(path), where=str(path), next_step=AGAIN)
    form, body, repairs = _form(first, path)
    log = _read(chain([body], rest), form, path)
    return log.repaired(*repairs, *_end(blocks.rest, form))


def _end(rest: bytes, form: _Form) -> tuple[str, ...]:
    """What is to be said of a last line without an end: some programs write none after the last row."""
    if not rest.strip():
        return ()
    if rest.count(form.separator.encode()) < len(form.names) - 1:
        return ("The log was cut in the middle of a line, which was dropped.",)
    return ("The last line has no end (a cut file?) and was dropped.",)


def _nothing(path: Path) -> str:
    """Why there is no whole line."""
    with path.open("rb") as file:
        blank = not file.read(2**16).strip()
    return "the log file is blank" if blank else "the log file has no complete line"


def _form(first: bytes, path: Path) -> tuple[_Form, bytes, tuple[str, ...]]:
    """How the table is written, by its first block; that block without the header; what was done."""
    header = header_of(first, str(path))
    body = first[header.end :].lstrip(b"\n")
    sample = body[: 2**16].decode(errors="ignore").split("\n")[:20]
    comma = header.separator != "," and bool(DECIMAL_COMMA.search("\n".join(sample)))
    said = ("Numbers were read with a decimal comma.",) if comma else ()
    form = _Form(header.names, header.separator, comma)
    return _judged(form, body, path), body, (*header.repairs, *said)


def _judged(form: _Form, body: bytes, path: Path) -> _Form:
    """The form with the types of its columns: numbers where most of the first cells are."""
    end = 0
    for _ in range(JUDGED):
        place = body.find(b"\n", end)
        if place < 0:
            break
        end = place + 1
    frame = _text_frame(body[:end], form, path)
    numeric = []
    for series in frame.iter_columns():
        told = int((series.fill_null("").str.strip_chars() != "").sum())
        numbers = int(np.isfinite(_numbers(series, form)).sum())
        numeric.append(2 * numbers >= told)
    return _Form(form.names, form.separator, form.decimal_comma, tuple(numeric))


def _read(blocks: Iterator[bytes], form: _Form, path: Path) -> Log:
    if all(form.numeric):
        return raw_log(_all_numbers(blocks, form, path), path.name)
    import polars as pl

    frames = [_mixed(block, form, path) for block in blocks if block.strip()]
    return frame_log(pl.concat(frames) if frames else _text_frame(b"", form, path), path)


def _all_numbers(blocks: Iterator[bytes], form: _Form, path: Path) -> dict[str, Array]:
    """(T,) of each column, in place from the first block on: memory that is not written to costs nothing."""
    rows, columns = 0, [np.empty(0) for _ in form.names]
    for block in blocks:
        if not block.strip():
            continue
        own = _numeric_columns(block, form, path)
        end = rows + len(own[0])
        if end > len(columns[0]):
            expected = int(1.1 * len(own[0]) * path.stat().st_size / len(block))
            columns = [_longer(column, rows, max(expected, 2 * end)) for column in columns]
        for column, values in zip(columns, own, strict=True):
            column[rows:end] = values
        rows = end
    return {name: column[:rows] for name, column in zip(form.names, columns, strict=True)}


def _longer(column: Array, rows: int, length: int) -> Array:
    out = np.empty(length)
    out[:rows] = column[:rows]
    return out


def _numeric_columns(block: bytes, form: _Form, path: Path) -> list[Array]:
    """The columns of a block of numbers; one that has other cells is looked at cell by cell."""
    import polars as pl

    frame = _frame(block, form, path, [pl.Float64] * len(form.names))
    if any(series.null_count() for series in frame.iter_columns()):
        frame = _text_frame(block, form, path)
        return [_numbers(series, form) for series in frame.iter_columns()]
    return [series.to_numpy() for series in frame.iter_columns()]


def _mixed(block: bytes, form: _Form, path: Path) -> pl.DataFrame:
    """A block whose columns of text stay text."""
    import polars as pl

    frame = _text_frame(block, form, path)
    columns = [
        pl.Series(name, _numbers(frame[name], form)) if numeric else frame[name]
        for name, numeric in zip(form.names, form.numeric, strict=True)
    ]
    return pl.DataFrame(columns)


def _numbers(series: pl.Series, form: _Form) -> Array:
    return numbers_of(series.str.replace(",", ".", literal=True) if form.decimal_comma else series)


def _text_frame(block: bytes, form: _Form, path: Path) -> pl.DataFrame:
    import polars as pl

    return _frame(block, form, path, [pl.String] * len(form.names))


def _frame(block: bytes, form: _Form, path: Path, dtypes: Sequence[type[pl.DataType]]) -> pl.DataFrame:
    import polars as pl

    schema = dict(zip(form.names, dtypes, strict=True))
    if not block.strip():
        return pl.DataFrame(schema=schema)
    # The first line says how many columns there are: before one that lacks cells goes a line of empty ones.
    separator, most = form.separator.encode(), len(form.names) - 1
    short = block.partition(b"\n")[0].count(separator) < most
    text = separator * most + b"\n" + block if short else block

    def parsed() -> pl.DataFrame:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that a block is malformed shows in its cells
            return pl.read_csv(
                text,
                has_header=False,
                separator=form.separator,
                comment_prefix="#",
                schema=schema,
                decimal_comma=form.decimal_comma and dtypes[0] != pl.String,
                ignore_errors=True,
                truncate_ragged_lines=True,
            )

    return guarded(parsed, path, "CSV")[int(short) :]
