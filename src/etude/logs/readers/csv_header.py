"""Where a table in text begins: its separator, its header in one row or two, units, and lines above."""

from __future__ import annotations

import csv
import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from etude.errors import DataError
from etude.logs.columns.echo import echo_names, is_number
from etude.logs.columns.vocabulary import MINUTES, NAMELESS, NUMBERED, TIME_UNITS, UNITS
from etude.logs.readers.table_text import restored

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
    """What stands above the rows.

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
class _Line:
    text: str
    end: int
    """Where it ends in the block, its line feed included."""


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
        said = "There is no header; the columns are those of `ros2 topic echo --csv`."
        return Header(tuple(echoed), separator, 0, (said,))
    if all(is_number(cell) for cell in first):
        return _commented(lines, plain[0], separator, where)
    found = _above(plain, where) or Header(tuple(first), separator, plain[0].end)
    rows = [line for line in plain if line.end > found.end]
    found = _named(_second(found, rows, where))
    _check(found, [line for line in rows if line.end > found.end], where)
    return found


def _lines(block: bytes) -> Iterator[_Line]:
    """Lines that are not blank, without those that only tell Excel the separator."""
    end = 0
    while end < len(block):
        place = block.find(b"\n", end)
        stop = len(block) if place < 0 else place + 1
        text = block[end:stop].decode().strip("\r\n ")
        if text.strip() and not EXCEL.fullmatch(text):
            yield _Line(text, stop)
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
    """Without the quotes of a cell that a blank stands before."""
    return cell[1:-1] if len(cell) > 1 and cell[0] == cell[-1] == '"' else cell


def _commented(lines: Sequence[_Line], first: _Line, separator: str, where: str) -> Header:
    """The header of rows above which it stands as a comment, as `numpy.savetxt` writes it; numbers where
    there is none, which mean nothing until [log.columns] says what.
    """
    above = [line for line in lines if line.end < first.end]
    width = len(_cells(first.text, separator, where))
    names = _cells(above[-1].text.lstrip("# "), separator, where) if above else []
    if len(names) != width or any(is_number(name) for name in names):
        numbers = tuple(f"{NUMBERED} {k}" for k in range(1, width + 1))
        return Header(numbers, separator, 0, ("There is no header: columns are numbered from 1.",))
    found = Header(tuple(names), separator, above[-1].end)
    _check(found, [first], where)
    return found


def _above(plain: Sequence[_Line], where: str) -> Header | None:
    """The header below lines of another kind: a title, settings of the recorder; None if none is found.

    It is the first line of names with as many cells as the line of numbers below it.
    """
    for k, (line, below) in enumerate(itertools.pairwise(plain)):
        separator = _separator(line.text)
        names, cells = (_cells(one.text, separator, where) for one in (line, below))
        told = len(names) > 1 and _is_names(line.text, separator, len(cells), where)
        if told and sum(map(is_number, cells)) > len(cells) / 2:
            if k and _is_names(plain[k - 1].text, separator, len(names), where):
                k, line = k - 1, plain[k - 1]  # a row of units, or a second one of names, is below
            names = _cells(line.text, separator, where)
            said = f"{k} line{'s'[: k > 1]} above the header {'were' if k > 1 else 'was'} left out."
            return Header(tuple(names), separator, line.end, (said,) if k else ())
    return None


def _is_names(line: str, separator: str, width: int, where: str) -> bool:
    cells = _cells(line, separator, where)
    return len(cells) == width and not any(map(is_number, cells))


def _second(found: Header, rows: Sequence[_Line], where: str) -> Header:
    """The header with the row below it, if that holds units, or tells apart names that stand twice."""
    cells = _cells(rows[0].text, found.separator, where) if rows else []
    if len(cells) != len(found.names) or not any(cells) or any(is_number(cell) for cell in cells):
        return found
    units = [cell.strip("[]() ").lower().replace("-", "") for cell in cells]
    if all(unit in UNITS or unit in TIME_UNITS or unit in MINUTES for unit in units):
        pairs = zip(found.names, units, strict=True)
        names, said = (
            [f"{name} [{u}]" if u else name for name, u in pairs],
            "Units are those of the second row.",
        )
    elif len(set(found.names)) < len(found.names):
        both = zip(found.names, cells, strict=True)
        names, said = [".".join(filter(None, pair)) for pair in both], "The header has two rows."
    else:
        return found
    return replace(found, names=tuple(names), end=rows[0].end, repairs=(*found.repairs, said))


def _named(found: Header) -> Header:
    """The header with a name for columns that have none: an index, or separators at the end of lines."""
    names = tuple(name or f"{NAMELESS} {k}" for k, name in enumerate(found.names, 1))
    return replace(found, names=names)


def _check(found: Header, rows: Sequence[_Line], where: str) -> None:
    """DataError: a name is a fraction or stands twice, or the first row has more cells than there are
    columns, so that nobody knows which is which.
    """
    number = next((name for name in found.names if is_number(name) and not name.lstrip("+-").isdigit()), "")
    if number:
        raise DataError(
            f"the line that ought to be the header holds a number ({number})",
            where=where,
            next_step="Add a header row such as t,q_<joint>,tau_<joint>; of rows of several kinds, export "
            "each kind on its own.",
        )
    double = sorted({name for name in found.names if found.names.count(name) > 1})
    if double:
        raise DataError(f"column '{double[0]}' appears twice", where=where, next_step="Remove one of them.")
    cells = _cells(rows[0].text, found.separator, where) if rows else []
    if len(cells) > len(found.names):
        raise DataError(
            f"the header names {len(found.names)} columns, and the first row has {len(cells)} cells",
            where=where,
            next_step="Name every column in the header, or take out separators at the end of rows.",
        )
