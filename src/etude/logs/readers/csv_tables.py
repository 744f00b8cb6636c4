"""Tables in text as raw logs, block by block: separators, decimal commas, headers, and columns of text.

The beginning of the file decides the type of a column. Numbers are parsed block by block, so a long log is
never in memory as text. Other cells in a column of numbers become NaN.

`ros2 topic echo --csv` writes no header: sec, nanosec, frame, then the names of all joints, their positions,
velocities and efforts.
"""

from __future__ import annotations

import codecs
import csv
import itertools
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from etude.errors import DataError
from etude.logs.columns.header_units import unit_in
from etude.logs.columns.vocabulary import MINUTES, NAMELESS, NUMBERED, TIME_SPELLINGS, TIME_UNITS
from etude.logs.readers.cells import numbers_of, restored
from etude.logs.readers.frames import frame_log, guarded, raw_log
from etude.types import Array, Log

if TYPE_CHECKING:
    import polars as pl

TYPE_ROWS = 1000
"""First rows, which decide the type of a column."""
DECIMAL_COMMA = re.compile(r"(?:^|[;\t| ])\s*-?\d*,\d+(?:[eE][-+]?\d+)?\s*(?=[;\t| ]|$)", re.MULTILINE)


@dataclass(frozen=True)
class _Form:
    """Form of the table, and which of its columns have numbers."""

    names: tuple[str, ...]
    separator: str
    decimal_comma: bool
    numeric: tuple[bool, ...] = ()


BLOCK = 2**20
"""Bytes that are read at once."""
LONGEST_LINE = 2**26
"""Bytes: what has no line end for longer is no table."""
ENCODINGS = {codecs.BOM_UTF8: "utf-8", codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}


@dataclass
class TextBlocks:
    """Blocks of whole lines in UTF-8 with line feeds, to be gone through once.

    Attributes:
        path: the file.
        unended: the last line, if it has no end; it is left out, since part of its last number may be lost.
    """

    path: Path
    unended: bytes = b""

    def __iter__(self) -> Iterator[bytes]:
        """DataError: the file is binary."""
        pending, lost_feed = b"", False
        with self.path.open("rb") as file:
            start = file.read(3)
            mark = next((candidate for candidate in ENCODINGS if start.startswith(candidate)), b"")
            file.seek(len(mark))
            decoder = codecs.getincrementaldecoder(ENCODINGS.get(mark, "utf-8"))()
            while data := file.read(BLOCK):
                text = self._decoded(decoder, data)
                if b"\r" in text or lost_feed:
                    if lost_feed and text.startswith(b"\n"):  # CR LF, half in the block before
                        text = text[1:]
                    lost_feed = text.endswith(b"\r")
                    text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
                lines, feed, remainder = text.rpartition(b"\n")
                if feed:
                    yield pending + lines + feed
                    pending = remainder
                else:
                    pending += remainder
                if len(pending) > LONGEST_LINE:
                    raise self._binary()
        self.unended = pending

    def _decoded(self, decoder: codecs.IncrementalDecoder, data: bytes) -> bytes:
        try:
            text = decoder.decode(data).encode()
        except UnicodeError:
            raise self._binary() from None
        if b"\0" in text:
            raise self._binary()
        return text

    def _binary(self) -> DataError:
        return DataError(
            "this is a binary file, not CSV text",
            where=str(self.path),
            next_step="Export the log as CSV or Parquet.",
        )


AGAIN = "Export the log again."
SEPARATORS, RARER = ",;\t", "| "
"""One of the rarer is the separator where a line has none of the others."""
LOOKED_AT = 40
"""Lines among which the header is looked for."""
QUOTED = re.compile(r'"(?:[^"]|"")*"')
EXCEL = re.compile(r'"?sep=.?"?', re.IGNORECASE)
"""A first line by which Excel is told the separator; the tab is lost when blanks are."""


@dataclass(frozen=True)
class Header:
    """The part of the file above the rows.

    Attributes:
        names: of the columns. separator: between cells.
        end: bytes of the first block before the rows.
        repairs: a sentence for each thing that is not plain.
    """

    names: tuple[str, ...]
    separator: str
    end: int
    repairs: tuple[str, ...] = ()


@dataclass(frozen=True)
class _TextLine:
    text: str
    end: int
    """Where it ends in the block, its line feed included."""


STAMP = ("header.stamp.sec", "header.stamp.nanosec", "header.frame_id")
ARRAYS = ("position", "velocity", "effort")


def echo_names(cells: Sequence[str], where: str) -> list[str]:
    """Headers for the cells of a first line that is such a message; none for any other line.

    Raises:
        DataError: each joint has two values, of which the second may be either of two things; or there are
            no names and the values are not three a joint.
    """
    if len(cells) < 5 or not (cells[0].isdigit() and cells[1].isdigit() and int(cells[1]) < 10**9):
        return []
    numbers = [is_number(cell) for cell in cells[3:]]
    joints = numbers.index(True) if True in numbers else 0
    values = len(numbers) - joints
    if not joints:
        return [] if is_number(cells[2]) or not all(numbers) else _nameless(len(numbers), where)
    if is_number(cells[2]) or not all(numbers[joints:]) or values % joints:
        return []
    arrays = values // joints
    if arrays == 2:
        header = ",".join(
            [*STAMP, *(f"{w}[{i}]" for w in ("name", "position", "effort") for i in range(joints))]
        )
        raise DataError(
            "a message has two values for each joint: position, and velocity or effort",
            where=where,
            next_step=f"Add a header row, for efforts: {header}",
        )
    if arrays > len(ARRAYS):
        return []
    return [*STAMP, *(f"{word}[{i}]" for word in ("name", *ARRAYS[:arrays]) for i in range(joints))]


def _nameless(values: int, where: str) -> list[str]:
    """Headers of a message without names: three arrays, of which the count of joints is to be right."""
    joints, left = divmod(values, len(ARRAYS))
    if left:
        raise DataError(
            f"a message without names of joints has {values} values, which do not fit position, velocity "
            "and effort of each joint",
            where=where,
            next_step=f"Add a header row: {','.join(STAMP)}, then position[0],position[1],... and so on.",
        )
    return [*STAMP, *(f"{word}[{i}]" for word in ARRAYS for i in range(joints))]


def is_number(text: str) -> bool:
    """Whether a cell is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def header_of(block: bytes, where: str) -> Header:
    """How the table in a file begins, by its first block of whole lines.

    Raises:
        DataError: there is no header, a broken one, or rows with more cells than it names.
    """
    lines = list(itertools.islice(_lines(block), LOOKED_AT))
    plain = [line for line in lines if not line.text.startswith("#")]
    if not plain:
        raise DataError("the log file has no rows, only comments", where=where, next_step=AGAIN)
    separator = _separator(plain[0].text)
    first = _cells(plain[0].text, separator, where)
    echoed = echo_names(first, where)
    if echoed:
        sentence = "There is no header; the columns are those of `ros2 topic echo --csv`."
        return Header(tuple(echoed), separator, 0, (sentence,))
    if all(is_number(cell) for cell in first):
        return _header_in_comment(lines, plain[0], separator, where)
    header = _header_after_preamble(plain, where) or Header(tuple(first), separator, plain[0].end)
    rows = [line for line in plain if line.end > header.end]
    header = _with_all_names(_with_second_row(header, rows, where))
    _check(header, [line for line in rows if line.end > header.end], where)
    return header


def _lines(block: bytes) -> Iterator[_TextLine]:
    """Lines that are not blank, without those that only tell Excel the separator."""
    end = 0
    while end < len(block):
        place = block.find(b"\n", end)
        stop = len(block) if place < 0 else place + 1
        text = block[end:stop].decode().strip("\r\n ")
        if text.strip() and not EXCEL.fullmatch(text):
            yield _TextLine(text, stop)
        end = stop


def _separator(line: str) -> str:
    bare = QUOTED.sub("", line)
    usual = max(SEPARATORS, key=bare.count)
    return usual if usual in bare else max(RARER, key=bare.count)


def _cells(line: str, separator: str, where: str) -> list[str]:
    try:
        cells = next(csv.reader([line], delimiter=separator), [])
        return [restored(_unquoted(cell.strip())) for cell in cells]
    except csv.Error as problem:
        raise DataError(f"the header cannot be read ({problem})", where=where, next_step=AGAIN) from None


def _unquoted(cell: str) -> str:
    """The cell without its quotes, if a blank precedes them."""
    return cell[1:-1] if len(cell) > 1 and cell[0] == cell[-1] == '"' else cell


def _header_in_comment(lines: Sequence[_TextLine], first: _TextLine, separator: str, where: str) -> Header:
    """The header of rows above which it stands as a comment, as `numpy.savetxt` writes it; numbers where
    there is none, which mean nothing until [log.columns] says what.
    """
    above = [line for line in lines if line.end < first.end]
    width = len(_cells(first.text, separator, where))
    names = _cells(above[-1].text.lstrip("# "), separator, where) if above else []
    if len(names) != width or any(is_number(name) for name in names):
        numbers = tuple(f"{NUMBERED} {k}" for k in range(1, width + 1))
        return Header(numbers, separator, 0, ("There is no header: columns are numbered from 1.",))
    header = Header(tuple(names), separator, above[-1].end)
    _check(header, [first], where)
    return header


def _header_after_preamble(plain: Sequence[_TextLine], where: str) -> Header | None:
    """The header below lines of another kind: a title, settings of the recorder; None if none is found.

    It is the first line of names with as many cells as the line of numbers below it.
    """
    for k, (line, below) in enumerate(itertools.pairwise(plain)):
        separator = _separator(line.text)
        names, cells = (_cells(one.text, separator, where) for one in (line, below))
        named = len(names) > 1 and _is_names(line.text, separator, len(cells), where)
        if named and sum(map(is_number, cells)) > len(cells) / 2:
            if k and _is_names(plain[k - 1].text, separator, len(names), where):
                k, line = k - 1, plain[k - 1]  # a row of units, or a second one of names, is below
            names = _cells(line.text, separator, where)
            sentence = f"{k} line{'s'[: k > 1]} above the header {'were' if k > 1 else 'was'} ignored."
            return Header(tuple(names), separator, line.end, (sentence,) if k else ())
    return None


def _is_names(line: str, separator: str, width: int, where: str) -> bool:
    cells = _cells(line, separator, where)
    return len(cells) == width and not any(map(is_number, cells))


def _with_second_row(header: Header, rows: Sequence[_TextLine], where: str) -> Header:
    """The header with the row below it, if that holds units, or tells apart names that stand twice."""
    cells = _cells(rows[0].text, header.separator, where) if rows else []
    if len(cells) != len(header.names) or not any(cells) or any(is_number(cell) for cell in cells):
        return header
    units = [cell.strip("[]() -").lower() for cell in cells]
    if all(unit_in(unit) or unit in {**TIME_UNITS, **MINUTES, **TIME_SPELLINGS} for unit in units):
        pairs = zip(header.names, units, strict=True)
        names, sentence = (
            [f"{name} [{u}]" if u else name for name, u in pairs],
            "The second row states the units.",
        )
    elif len(set(header.names)) < len(header.names):
        both = zip(header.names, cells, strict=True)
        names, sentence = [".".join(filter(None, pair)) for pair in both], "The header has two rows."
    else:
        return header
    return replace(header, names=tuple(names), end=rows[0].end, repairs=(*header.repairs, sentence))


def _with_all_names(header: Header) -> Header:
    """The header with a name for columns that have none: an index, or separators at the end of lines."""
    names = tuple(name or f"{NAMELESS} {k}" for k, name in enumerate(header.names, 1))
    return replace(header, names=names)


def _check(header: Header, rows: Sequence[_TextLine], where: str) -> None:
    """Raises a DataError if a name is a fraction or occurs twice, or if the first row has more cells than
    there are columns.
    """
    number = next((name for name in header.names if is_number(name) and not name.lstrip("+-").isdigit()), "")
    if number:
        raise DataError(
            f"the header line holds a number ({number})",
            where=where,
            next_step="Add a header row such as t,q_<joint>,tau_<joint>; if rows have several kinds, "
            "export each kind separately.",
        )
    double = sorted({name for name in header.names if header.names.count(name) > 1})
    if double:
        raise DataError(f"column '{double[0]}' appears twice", where=where, next_step="Remove one of them.")
    cells = _cells(rows[0].text, header.separator, where) if rows else []
    if len(cells) > len(header.names):
        raise DataError(
            f"the header names {len(header.names)} columns, but the first row has {len(cells)} cells",
            where=where,
            next_step="Name every column in the header, or remove separators at the end of rows.",
        )


def csv_log(path: Path) -> Log:
    """The raw columns of comma, semicolon or tab separated text; lines that start with # are skipped,
    and Excel's `sep=;`.

    Raises:
        DataError: not text, blank, without a header or with a broken one.
    """
    blocks = TextBlocks(path)
    remaining = iter(blocks)
    first = next((block for block in remaining if block.strip()), b"")
    if not first:
        raise DataError(_reason_without_rows(path), where=str(path), next_step=AGAIN)
    form, body, repairs = _detect_form(first, path)
    log = _read(chain([body], remaining), form, path)
    return log.repaired(*repairs, *_end_sentences(blocks.unended, form))


def _end_sentences(line: bytes, form: _Form) -> tuple[str, ...]:
    """A sentence on a last line without an end; none if it is blank."""
    if not line.strip():
        return ()
    if line.count(form.separator.encode()) < len(form.names) - 1:
        return ("The log was cut in the middle of a line, which was dropped.",)
    return ("The last line is incomplete (a truncated file?) and was dropped.",)


def _reason_without_rows(path: Path) -> str:
    """Reason why there is no complete line."""
    with path.open("rb") as file:
        blank = not file.read(2**16).strip()
    return "the log file is blank" if blank else "the log file has no complete line"


def _detect_form(first: bytes, path: Path) -> tuple[_Form, bytes, tuple[str, ...]]:
    """How the table is written, by its first block; that block without the header; what was done."""
    header = header_of(first, str(path))
    body = first[header.end :].lstrip(b"\n")
    sample = body[: 2**16].decode(errors="ignore").split("\n")[:20]
    comma = header.separator != "," and bool(DECIMAL_COMMA.search("\n".join(sample)))
    sentences = ("Numbers were read with a decimal comma.",) if comma else ()
    form = _Form(header.names, header.separator, comma)
    return _with_types(form, body, path), body, (*header.repairs, *sentences)


def _with_types(form: _Form, body: bytes, path: Path) -> _Form:
    """The form with the types of its columns: numbers where most of the first cells are."""
    end = 0
    for _ in range(TYPE_ROWS):
        place = body.find(b"\n", end)
        if place < 0:
            break
        end = place + 1
    frame = _text_frame(body[:end], form, path)
    numeric = []
    for series in frame.iter_columns():
        filled = int((series.fill_null("").str.strip_chars() != "").sum())
        numbers = int(np.isfinite(_numbers(series, form)).sum())
        numeric.append(2 * numbers >= filled)
    return _Form(form.names, form.separator, form.decimal_comma, tuple(numeric))


def _read(blocks: Iterator[bytes], form: _Form, path: Path) -> Log:
    if all(form.numeric):
        return raw_log(_all_numbers(blocks, form, path), path.name)
    import polars as pl

    frames = [_mixed_columns(block, form, path) for block in blocks if block.strip()]
    return frame_log(pl.concat(frames) if frames else _text_frame(b"", form, path), path)


def _all_numbers(blocks: Iterator[bytes], form: _Form, path: Path) -> dict[str, Array]:
    """(T,) of each column, in place from the first block on: memory that is not written to costs nothing."""
    rows, columns = 0, [np.empty(0) for _ in form.names]
    for block in blocks:
        if not block.strip():
            continue
        numbers = _numeric_columns(block, form, path)
        end = rows + len(numbers[0])
        if end > len(columns[0]):
            # rows of the whole file, by this block's, and a tenth more since numbers differ in length
            expected = int(1.1 * len(numbers[0]) * path.stat().st_size / len(block))
            columns = [_extended(column, rows, max(expected, 2 * end)) for column in columns]
        for column, values in zip(columns, numbers, strict=True):
            column[rows:end] = values
        rows = end
    return {name: column[:rows] for name, column in zip(form.names, columns, strict=True)}


def _extended(column: Array, rows: int, length: int) -> Array:
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


def _mixed_columns(block: bytes, form: _Form, path: Path) -> pl.DataFrame:
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
