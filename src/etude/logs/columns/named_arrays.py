"""Arrays of joints in a table: values mapped by the names that stand beside them; entries without names
are numbered, and matched as numbered columns are: only if there is one for each joint.

A recorder of joint states writes lists, `name` and `position`, or a column for each entry, `name[0]` and
`position[0]`. The order may change from row to row.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from etude.errors import DataError
from etude.logs.columns.vocabulary import normal
from etude.logs.readers.cells import is_list, is_text, lists_of, matrix, numbers_of, rectangle, texts_of
from etude.types import Array

if TYPE_CHECKING:
    import polars as pl

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
    found: dict[str, Array] = {}
    used: set[str] = set()
    sentences: list[str] = []
    for arrays in (*_lists(columns), *_numbered(columns)):
        if arrays.names is None:
            found |= _entries(arrays.values)
            sentences += _said(arrays)
        elif arrays.values:
            rows = _by_name(arrays.names, where)
            for stem, values in arrays.values.items():
                found |= {f"{stem}/{name}": _taken(values, at) for name, at in rows.items()}
            sentences.append(f"Columns {', '.join(arrays.values)} were mapped to joints by the names beside.")
        used.update(arrays.used)
    return found, used, tuple(sentences)


def _entries(values: Mapping[str, Array]) -> dict[str, Array]:
    """`position[0]` -> (T,) of lists without names."""
    return {f"{stem}[{i}]": column for stem, rows in values.items() for i, column in enumerate(rows.T)}


def _said(arrays: _Arrays) -> list[str]:
    left = [header for header in arrays.used if header not in arrays.values]
    sentences = (
        [f"Columns {', '.join(left)} hold lists of no numbers or of many; they were ignored."] if left else []
    )
    if arrays.values:
        own = ", ".join(arrays.values)
        sentences.append(f"Columns {own} hold lists without names; their entries were numbered from 0.")
    return sentences


def _by_name(names: Any, where: str) -> dict[str, Any]:
    """Name -> (T,) the entry that holds it in each row, -1 where none does."""
    rows = len(names)
    if not rows:
        return {}
    constant = bool((names == names[:1]).all())
    counts = Counter(names[0].tolist() if constant else names.ravel().tolist())
    found = {}
    for name, count in counts.items():
        if not name or (not constant and count < LEAST_ROWS * rows):
            continue
        match = names[:1] == name if constant else names == name
        if (match.sum(axis=1) > 1).any():
            raise DataError(
                f"the name '{name}' stands twice in one row",
                where=where,
                next_step="Export the log again with each joint's name once.",
            )
        at = np.where(match.any(axis=1), match.argmax(axis=1), -1)
        found[name] = np.full(rows, at[0]) if constant else at
    return found


def _taken(values: Array, at: Any) -> Array:
    inside = (at >= 0) & (at < values.shape[1])
    picked = values[np.arange(len(values)), np.where(inside, at, 0)]
    return np.asarray(np.where(inside, picked, np.nan))


def _numbered(columns: Mapping[str, pl.Series]) -> list[_Arrays]:
    """Arrays as one column for each entry, of those that have names."""
    entries: dict[str, dict[int, str]] = {}
    for header in columns:
        match = ENTRY.fullmatch(normal(header))
        if match is not None and len(match["index"]) < 4:
            entries.setdefault(match["stem"], {})[int(match["index"])] = header
    found = []
    for stem, headers in entries.items():
        prefix = NAMES.fullmatch(stem)
        if prefix is None or not all(is_text(columns[h]) for h in headers.values()):
            continue
        indices = sorted(headers)
        names = np.stack([texts_of(columns[headers[i]]) for i in indices], axis=1)
        own = {s: e for s, e in entries.items() if s != stem and s.startswith(prefix["prefix"])}
        values = {s: _columns(columns, e, indices) for s, e in own.items() if set(e) & set(indices)}
        used = [*headers.values(), *(h for s in values for h in own[s].values())]
        found.append(_Arrays(names, values, tuple(used)))
    return found


def _columns(columns: Mapping[str, pl.Series], entries: Mapping[int, str], indices: Sequence[int]) -> Array:
    """(T, n) in the order of the names' indices; NaN for an entry that is not there."""
    rows = len(next(iter(columns.values())))
    empty = np.full(rows, np.nan)
    return np.stack([numbers_of(columns[entries[i]]) if i in entries else empty for i in indices], axis=1)


def _lists(columns: Mapping[str, pl.Series]) -> list[_Arrays]:
    """Arrays as one column of lists; those without names are reported as such."""
    lists = {header: series for header, series in columns.items() if is_list(series)}
    texts = {h: p["prefix"] for h in lists if (p := NAMES.fullmatch(normal(h))) is not None}
    found: list[_Arrays] = []
    taken: set[str] = set()
    for header, prefix in texts.items():
        own = [h for h in lists if h not in texts and normal(h).startswith(prefix)]
        values = {h: _numbers(lists[h]) for h in own}
        found.append(_Arrays(matrix(lists_of(lists[header]), str), values, (header, *own)))
        taken.update((header, *own))
    alone = tuple(h for h in lists if h not in taken)
    values = {h: rows for h in alone if (rows := _unnamed(lists[h])) is not None}
    return [*found, *([_Arrays(None, values, alone)] if alone else [])]


def _numbers(series: pl.Series) -> Array:
    """(T, n) of lists of any length."""
    even = rectangle(series)
    return np.asarray(matrix(lists_of(series), float)) if even is None else even


def _unnamed(series: pl.Series) -> Array | None:
    """(T, n) of lists without names; None if they differ in length, which hides whose each entry is, hold no
    numbers, or more than any robot has joints.
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
