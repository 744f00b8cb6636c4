"""Data frames as raw logs: a channel for each numeric column, with all polars errors as one error.

Text is read as numbers where it is one, else NaN. Lists, and columns that are numbered like `position[0]`,
take the names beside them (`name`, `name[0]`), row by row: the order of joints may be any. Entries without
names are numbered, and matched as numbered columns are: only if there is one for each joint.

With a damaged count a decoder requests more memory than exists, and the process ends without an exception. So
the counts in footer and page headers are checked here first.
"""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from etude.errors import DataError
from etude.logs.readers.cells import numbers_of
from etude.logs.readers.memory_budget import BESIDE, MemoryBudget
from etude.types import Array, Channel, Log

if TYPE_CHECKING:
    import polars as pl

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from etude.logs.columns.vocabulary import normal
from etude.logs.readers.cells import is_list, is_text, lists_of, matrix, rectangle, texts_of

if TYPE_CHECKING:
    import polars as pl

T = TypeVar("T")
DEEPEST_COLUMN = 8  # structs within structs
TEXTS = 2  # how often a column of text is held while it is read as numbers


def raw_log(columns: Mapping[str, Array], source: str, repairs: tuple[str, ...] = ()) -> Log:
    """A log with a channel for each column (T,), neither matched nor converted; its times are row numbers."""
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
    columns = {s.name: s for s in guarded(partial(_flatten, frame), path, "a table").iter_columns()}
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
    return parquet_table(path)[0]


def parquet_table(path: Path) -> tuple[pl.DataFrame, Mapping[str, str]]:
    """All columns of a Parquet file, and its `parquet_metadata`. Errors as these."""
    import polars as pl

    def read(file: io.BytesIO) -> tuple[pl.DataFrame, Mapping[str, str]]:
        facts = pl.read_parquet_metadata(file)
        file.seek(0)
        return pl.read_parquet(file), facts

    frame, facts = _from_parquet(path, read)
    guarded(lambda: _count_text(frame, MemoryBudget(path)), path, "Parquet")
    return frame, facts


def _count_text(frame: pl.DataFrame, room: MemoryBudget) -> None:
    """Count the memory of text. Repeated text needs memory only when it is read. DataError: no room."""
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


POINTER = b"version https://git-lfs.github.com/spec/"


def check_whole(head: bytes, path: Path) -> None:
    """DataError: the file that begins with `head` is such a pointer."""
    if head.startswith(POINTER):
        raise DataError(
            "this is a pointer of Git LFS, not the file itself",
            where=str(path),
            next_step="Fetch it with git lfs pull in the cloned folder.",
        )


MAGIC = b"PAR1"
DEEPEST_SCHEMA = 32  # structs within structs
DATA, DICTIONARY, DATA_V2 = 0, 2, 3  # types of pages
LARGEST_RATIO = 2**17  # of a page's size to its compressed size: run lengths of zeros
NUMBER = 8  # bytes of a value in memory, of run lengths too
OF_LIST = 24  # and of one in a list, which is held as a table and as an array at once
ALWAYS_BELIEVED = 2**20  # bytes of a page that are always believed


def check_shape(data: bytes, room: MemoryBudget) -> None:
    """Checks the counts and sizes in a Parquet file.

    Raises:
        ValueError: with what does not fit. DataError: there is no room for its values.
    """
    # PAR1, ..., the footer, its length in 4 bytes, PAR1
    if len(data) < 12 or data[:4] != MAGIC or data[-4:] != MAGIC:
        raise ValueError("it does not begin and end as a Parquet file")
    length = int.from_bytes(data[-8:-4], "little")
    if length > len(data) - 12:
        raise ValueError("its footer is longer than the file")
    end = len(data) - 8 - length
    footer, _ = _struct(data, end, len(data) - 8)
    groups = footer.get(4, [])
    if sum(group[3] for group in groups) != footer.get(3, 0):
        raise ValueError("its row groups do not add up to its rows")
    room.take(BESIDE * max(int(footer.get(3, 0)), 0))
    for group in groups:
        for chunk in group[1]:
            whole = NUMBER if len(chunk[3][3]) == 1 else OF_LIST
            room.take(whole * max(int(chunk[3][5]), 0))
            _check_chunk(data, end, chunk[3], group[3])


def _check_chunk(data: bytes, end: int, chunk: Mapping[int, Any], rows: int) -> None:
    """Walks the pages of one column in one row group."""
    values, size = chunk[5], chunk[7]
    if values == 0:
        return
    # fields of ColumnMetaData in parquet.thrift: 9 is the first data page, 11 the dictionary's
    start = min(chunk[9], chunk.get(11) or chunk[9])
    if not (4 <= start <= start + size <= end) or values < 1 or (len(chunk[3]) == 1 and values != rows):
        raise ValueError("a column is not where the footer says, or not as long")
    stop, counted = start + size, 0
    while counted < values:
        header, start = _struct(data, start, stop)
        packed, unpacked = header[3], header[2]
        if not (
            0 <= packed <= stop - start and 0 <= unpacked <= max(ALWAYS_BELIEVED, LARGEST_RATIO * packed)
        ):
            raise ValueError("a page is longer than its column")
        counted += _values(header, unpacked)
        start += packed
    if counted != values:
        raise ValueError("the pages of a column do not add up to its values")


def _values(header: Mapping[int, Any], unpacked: int) -> int:
    """Values of a data page; 0 of others."""
    kind = header[1]
    if kind == DICTIONARY:
        if not 0 <= header[7][1] <= unpacked:
            raise ValueError("a dictionary counts more values than it can hold")
        return 0
    if kind not in (DATA, DATA_V2):
        return 0
    page = header[5 if kind == DATA else 8]
    count = int(page[1])
    levels = page.get(5, 0) + page.get(6, 0) if kind == DATA_V2 else 0
    nulls = page.get(2, 0) if kind == DATA_V2 else 0
    if count < 0 or not 0 <= nulls <= count or not 0 <= levels <= unpacked:
        raise ValueError("a page counts more values than it can hold")
    return count


def _struct(data: bytes, place: int, stop: int, depth: int = 0) -> tuple[dict[int, Any], int]:
    """Fields by number of a struct in Thrift's compact protocol, and the place behind it."""
    if depth > DEEPEST_SCHEMA:
        raise ValueError("its footer is nested too deeply")
    fields: dict[int, Any] = {}
    number = 0
    while True:
        byte, place = _byte(data, place, stop), place + 1
        if byte == 0:
            return fields, place
        if byte >> 4:
            number += byte >> 4
        else:
            number, place = _signed(data, place, stop)
        kind = byte & 15
        if kind in (1, 2):
            fields[number] = kind == 1
        else:
            fields[number], place = _value(kind, data, place, stop, depth)


def _value(kind: int, data: bytes, place: int, stop: int, depth: int) -> tuple[Any, int]:
    if kind in (1, 2, 3):
        return _byte(data, place, stop), place + 1
    if kind in (4, 5, 6):
        return _signed(data, place, stop)
    if kind == 7:
        return None, _within(place + 8, stop)
    if kind == 8:
        length, place = _varint(data, place, stop)
        return None, _within(place + length, stop)
    if kind in (9, 10):
        return _list(data, place, stop, depth)
    if kind == 12:
        return _struct(data, place, stop, depth + 1)
    raise ValueError("its footer cannot be read")


def _list(data: bytes, place: int, stop: int, depth: int) -> tuple[list[Any], int]:
    head, place = _byte(data, place, stop), place + 1
    count, kind = head >> 4, head & 15
    if count == 15:
        count, place = _varint(data, place, stop)
    if count > stop - place:
        raise ValueError("its footer is cut")
    items = []
    for _ in range(count):
        item, place = _value(kind, data, place, stop, depth + 1)
        items.append(item)
    return items, place


def _byte(data: bytes, place: int, stop: int) -> int:
    if place >= stop:
        raise ValueError("its footer is cut")
    return data[place]


def _within(place: int, stop: int) -> int:
    if place > stop:
        raise ValueError("its footer is cut")
    return place


def _varint(data: bytes, place: int, stop: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte, place = _byte(data, place, stop), place + 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, place
        shift += 7
        if shift > 63:
            raise ValueError("its footer cannot be read")


def _signed(data: bytes, place: int, stop: int) -> tuple[int, int]:
    value, place = _varint(data, place, stop)
    return (value >> 1) ^ -(value & 1), place


def _from_parquet(path: Path, read: Callable[[io.BytesIO], T]) -> T:
    def checked() -> T:
        data = path.read_bytes()
        check_whole(data, path)
        check_shape(data, MemoryBudget(path))
        with without_panics_on_screen():
            return read(io.BytesIO(data))

    return guarded(checked, path, "Parquet")


@contextlib.contextmanager
def without_panics_on_screen() -> Iterator[None]:
    """Discard the standard error of compiled code: a panic there is reported as an error here."""
    try:
        duplicate = os.dup(2)
    except OSError:  # there is no standard error
        yield
        return
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
            yield
    finally:
        os.dup2(duplicate, 2)
        os.close(duplicate)


def guarded(action: Callable[[], T], path: Path, format_: str) -> T:
    """The result of `action`; every error of polars becomes a DataError with the reason's first line.

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


def _flatten(frame: pl.DataFrame) -> pl.DataFrame:
    """The table with the fields of its structs as columns, `state.position`."""
    import polars as pl

    for _ in range(DEEPEST_COLUMN):
        nested = [name for name, dtype in frame.schema.items() if isinstance(dtype, pl.Struct)]
        if not nested:
            break
        for name in nested:
            fields = frame[name].struct.unnest()
            fields.columns = [f"{name}.{field}" for field in fields.columns]
            frame = frame.drop(name).hstack(fields)
    return frame


NAMES = re.compile(r"(?P<prefix>(?:.*?_)??)(?:joint_?)?names?")
ENTRY = re.compile(r"(?P<stem>.*?[a-z])_?(?P<index>\d+)")
MOST_JOINTS = 100  # wider arrays are images or point clouds
SAME_LENGTH = 0.9  # of the rows: lists without names are as long in all others than damaged ones
LEAST_ROWS = 0.5  # part of the rows that a name must stand in: the others are damaged cells


@dataclass(frozen=True)
class _Arrays:
    """Columns that belong together by what stands before their word: `/joint_states/`.

    Attributes:
        names: (T, n) text of the entries, or None.
        values: header's stem -> (T, n) numbers.
        used: the headers that they come from.
    """

    names: Any
    values: Mapping[str, Array]
    used: tuple[str, ...]


def named_columns(
    columns: Mapping[str, pl.Series], where: str
) -> tuple[dict[str, Array], set[str], tuple[str, ...]]:
    """(`position/elbow` -> (T,), the headers that these stand for, repairs) of a table's arrays.

    Raises:
        DataError: a name stands twice in one row.
    """
    joint_columns: dict[str, Array] = {}
    used: set[str] = set()
    sentences: list[str] = []
    for arrays in (*_list_arrays(columns), *_numbered_arrays(columns)):
        if arrays.names is None:
            joint_columns |= _entries(arrays.values)
            sentences += _list_sentences(arrays)
        elif arrays.values:
            rows = _by_name(arrays.names, where)
            for stem, values in arrays.values.items():
                joint_columns |= {f"{stem}/{name}": _picked(values, at) for name, at in rows.items()}
            sentences.append(
                f"Columns {', '.join(arrays.values)} were mapped to joints by the names in the same row."
            )
        used.update(arrays.used)
    return joint_columns, used, tuple(sentences)


def _entries(values: Mapping[str, Array]) -> dict[str, Array]:
    """`position[0]` -> (T,) of lists without names."""
    return {f"{stem}[{i}]": column for stem, rows in values.items() for i, column in enumerate(rows.T)}


def _list_sentences(arrays: _Arrays) -> list[str]:
    ignored = [header for header in arrays.used if header not in arrays.values]
    sentences = (
        [f"Columns {', '.join(ignored)} hold lists without numbers or with too many; they were ignored."]
        if ignored
        else []
    )
    if arrays.values:
        headers = ", ".join(arrays.values)
        sentences.append(f"Columns {headers} hold lists without names; their entries were numbered from 0.")
    return sentences


def _by_name(names: Any, where: str) -> dict[str, Any]:
    """Name -> (T,) the entry that holds it in each row, -1 where none does."""
    rows = len(names)
    if not rows:
        return {}
    constant = bool((names == names[:1]).all())
    counts = Counter(names[0].tolist() if constant else names.ravel().tolist())
    entries = {}
    for name, count in counts.items():
        if not name or (not constant and count < LEAST_ROWS * rows):
            continue
        match = names[:1] == name if constant else names == name
        if (match.sum(axis=1) > 1).any():
            raise DataError(
                f"the name '{name}' occurs twice in one row",
                where=where,
                next_step="Export the log again with each joint's name once.",
            )
        at = np.where(match.any(axis=1), match.argmax(axis=1), -1)
        entries[name] = np.full(rows, at[0]) if constant else at
    return entries


def _picked(values: Array, at: Any) -> Array:
    inside = (at >= 0) & (at < values.shape[1])
    picked = values[np.arange(len(values)), np.where(inside, at, 0)]
    return np.asarray(np.where(inside, picked, np.nan))


def _numbered_arrays(columns: Mapping[str, pl.Series]) -> list[_Arrays]:
    """Arrays as one column for each entry, of those that have names."""
    entries: dict[str, dict[int, str]] = {}
    for header in columns:
        match = ENTRY.fullmatch(normal(header))
        if match is not None and len(match["index"]) < 4:
            entries.setdefault(match["stem"], {})[int(match["index"])] = header
    arrays = []
    for stem, headers in entries.items():
        prefix = NAMES.fullmatch(stem)
        if prefix is None or not all(is_text(columns[h]) for h in headers.values()):
            continue
        indices = sorted(headers)
        names = np.stack([texts_of(columns[headers[i]]) for i in indices], axis=1)
        stems = {s: e for s, e in entries.items() if s != stem and s.startswith(prefix["prefix"])}
        values = {s: _columns(columns, e, indices) for s, e in stems.items() if set(e) & set(indices)}
        used = [*headers.values(), *(h for s in values for h in stems[s].values())]
        arrays.append(_Arrays(names, values, tuple(used)))
    return arrays


def _columns(columns: Mapping[str, pl.Series], entries: Mapping[int, str], indices: Sequence[int]) -> Array:
    """(T, n) in the order of the names' indices; NaN for an entry that is not there."""
    rows = len(next(iter(columns.values())))
    empty = np.full(rows, np.nan)
    return np.stack([numbers_of(columns[entries[i]]) if i in entries else empty for i in indices], axis=1)


def _list_arrays(columns: Mapping[str, pl.Series]) -> list[_Arrays]:
    """Arrays as one column of lists; those without names are reported as such."""
    lists = {header: series for header, series in columns.items() if is_list(series)}
    texts = {h: p["prefix"] for h in lists if (p := NAMES.fullmatch(normal(h))) is not None}
    arrays: list[_Arrays] = []
    taken: set[str] = set()
    for header, prefix in texts.items():
        headers = [h for h in lists if h not in texts and normal(h).startswith(prefix)]
        values = {h: _numbers(lists[h]) for h in headers}
        arrays.append(_Arrays(matrix(lists_of(lists[header]), str), values, (header, *headers)))
        taken.update((header, *headers))
    unnamed = tuple(h for h in lists if h not in taken)
    values = {h: rows for h in unnamed if (rows := _unnamed_lists(lists[h])) is not None}
    return [*arrays, *([_Arrays(None, values, unnamed)] if unnamed else [])]


def _numbers(series: pl.Series) -> Array:
    """(T, n) of lists of any length."""
    even = rectangle(series)
    return np.asarray(matrix(lists_of(series), float)) if even is None else even


def _unnamed_lists(series: pl.Series) -> Array | None:
    """(T, n) of lists without names; None: they differ in length, so that their entries are unknown, or
    they hold no numbers, or more than any robot has joints.
    """
    even = rectangle(series)
    if even is not None:
        return even if even.shape[1] <= MOST_JOINTS and np.isfinite(even).any() else None
    cells = lists_of(series)
    lengths = Counter(len(cell) for cell in cells if cell)
    (width, rows), *_ = lengths.most_common(1) or [(0, 0)]
    if not 0 < width <= MOST_JOINTS or rows < SAME_LENGTH * len(cells):
        return None
    values = np.asarray(matrix([cell if cell and len(cell) == width else None for cell in cells], float))
    values = values if values.shape[1] == width else np.full((len(cells), width), np.nan)
    return values if np.isfinite(values).any() else None
