"""MATLAB's files (version 4 to 7.2) as raw logs: vectors are columns, matrices several, structs paths."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from etude.errors import DataError
from etude.logs.readers.frames import raw_log
from etude.logs.readers.mat4 import is_mat4, variables4
from etude.logs.readers.mat5 import Variable, variables
from etude.logs.readers.unpacking import BESIDE, Room
from etude.types import Array, Log

HDF5 = (b"\x89HDF", b"MATLAB 7.3")
SIGNALS = ".signals.values"
HEAD = 128
WIDEST = 1000
"""Columns of a matrix: wider ones are images."""


def mat_log(path: Path) -> Log:
    """All numeric variables with one row for each sample; what has another length is left out and named.

    Raises:
        DataError: no MAT file, one of version 7.3, or without two variables of one length.
    """
    with path.open("rb") as file:
        head = file.read(HEAD)
    if head.startswith(HDF5):
        raise DataError(
            "this is a MAT file of version 7.3 (HDF5), which is not read",
            where=str(path),
            next_step="Save it in MATLAB with save(name, '-v7').",
        )
    found = _simulink(dict(_columns(_loaded(path), "")))
    lengths = Counter(len(values) for values in found.values() if len(values) > 1)
    if not lengths:
        raise DataError(
            "the file has no variable with more than one number",
            where=str(path),
            next_step="Save time, positions and commands as arrays with a row for each sample.",
        )
    rows = max(lengths, key=lambda n: (lengths[n], n))
    left = sorted(name for name, values in found.items() if len(values) != rows)
    own = {name: values for name, values in found.items() if len(values) == rows}
    own = _without_struct(own)
    said = f"Variables of another length than {rows} were left out: {', '.join(left[:12])}."
    return raw_log(own, path.name, (said,) if left else ())


def _simulink(found: dict[str, Array]) -> dict[str, Array]:
    """Signals that Simulink saved as structures with time (`q.time`, `q.signals.values_1`) under their own
    names, with the time that all of them share; as they are where times differ.
    """
    blocks = {name.partition(SIGNALS)[0] for name in found if SIGNALS in name}
    times = [found[f"{block}.time"] for block in blocks if f"{block}.time" in found]
    if not times or not all(np.array_equal(times[0], t) for t in times):
        return found
    own = {}
    for name, values in found.items():
        if name.removesuffix(".time") not in blocks:
            own[name.replace(SIGNALS, "").rpartition(".")[2] if SIGNALS in name else name] = values
    return {"time": times[0], **own}


def _without_struct(own: Mapping[str, Array]) -> dict[str, Array]:
    """The same names without the struct that holds them all: `log.q_1` is q_1."""
    heads = {name.partition(".")[0] for name in own}
    if len(heads) != 1 or not all("." in name for name in own):
        return dict(own)
    return _without_struct({name.partition(".")[2]: values for name, values in own.items()})


def _loaded(path: Path) -> Mapping[str, Variable]:
    try:
        with path.open("rb") as file:
            head = file.read(HEAD)
            file.seek(0)
            room = Room(path)
            found = variables4(file, room) if is_mat4(head) else variables(file, room)
        room.require(BESIDE * max((_rows(value) for value in found.values()), default=0))
        return found
    except (ValueError, struct.error, zlib.error) as problem:
        raise DataError(
            f"the file cannot be read as MAT ({problem})",
            where=str(path),
            next_step="It is cut or another kind of file; save it again, with '-v7'.",
        ) from None


def _rows(value: Variable) -> int:
    """Of the longest array in it."""
    if isinstance(value, Mapping):
        return max((_rows(own) for own in value.values()), default=0)
    return int(max(value.shape))


def _columns(found: Mapping[str, Variable], prefix: str) -> Iterator[tuple[str, Array]]:
    """(path, (T,)) of every array of numbers; a matrix's columns are numbered from 1, as MATLAB does."""
    for name, value in found.items():
        if not name:  # MATLAB's own notes on objects
            continue
        if isinstance(value, Mapping):
            yield from _columns(value, f"{prefix}{name}.")
            continue
        rows = value if value.shape[0] >= value.shape[1] else value.T
        if rows.shape[1] == 1:
            yield f"{prefix}{name}", rows[:, 0]
        elif rows.shape[1] <= WIDEST:
            yield from ((f"{prefix}{name}_{i}", column) for i, column in enumerate(rows.T, 1))
