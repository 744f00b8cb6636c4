"""MATLAB's files (version 5 to 7.2) as raw logs: vectors are columns, matrices several, structs paths."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from etude.contracts import Array, Log
from etude.errors import DataError
from etude.logs.frames import raw_log

HDF5 = (b"\x89HDF", b"MATLAB 7.3")
DEEPEST = 8
"""Structs within structs."""
WIDEST = 1000
"""Columns of a matrix: wider ones are images."""


def mat_log(path: Path) -> Log:
    """All numeric variables with one row for each sample; what has another length is left out and named.

    Raises:
        DataError: no MAT file, one of version 7.3, or without two variables of one length.
    """
    with path.open("rb") as file:
        head = file.read(128)
    if head.startswith(HDF5):
        raise DataError(
            "this is a MAT file of version 7.3 (HDF5), which is not read",
            where=str(path),
            next_step="Save it in MATLAB with save(name, '-v7').",
        )
    found = dict(_columns(_loaded(path), ""))
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
    said = f"Variables of another length than {rows} were left out: {', '.join(left[:12])}."
    return raw_log(own, path.name, (said,) if left else ())


def _loaded(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return dict(loadmat(path, struct_as_record=False, squeeze_me=True))
    except Exception as problem:  # SciPy's reader fails with anything
        first = (str(problem).strip().splitlines() or [type(problem).__name__])[0][:200]
        raise DataError(
            f"the file cannot be read as MAT ({first})",
            where=str(path),
            next_step="It is cut or another kind of file; save it again, with '-v7'.",
        ) from problem


def _columns(variables: dict[str, Any], prefix: str, depth: int = 0) -> Iterator[tuple[str, Array]]:
    """(path, (T,)) of every number array; a matrix's columns are numbered from 1, as MATLAB does."""
    for name, value in variables.items():
        place = f"{prefix}{name}"
        if name.startswith("__") or depth > DEEPEST:
            continue
        fields = getattr(value, "_fieldnames", None)
        if fields is not None:
            yield from _columns({f: getattr(value, f) for f in fields}, f"{place}.", depth + 1)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
            yield from _matrix(place, value)


def _matrix(place: str, value: np.ndarray[Any, Any]) -> Iterator[tuple[str, Array]]:
    values = np.asarray(value, dtype=np.float64)
    if values.ndim == 1:
        yield place, values
    elif values.ndim == 2:
        rows = values if values.shape[0] >= values.shape[1] else values.T
        if rows.shape[1] <= WIDEST:
            for i, column in enumerate(rows.T, 1):
                yield f"{place}_{i}", np.array(column)
