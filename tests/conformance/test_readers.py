"""What every log reader must do; a new suffix in READERS needs one row in WRITERS."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from etude.errors import DataError
from etude.logs.table import READERS, read_table

Columns = dict[str, list[float | None]]


def write_text(separator: str) -> Callable[[Path, Columns], None]:
    def write(path: Path, columns: Columns) -> None:
        pl.DataFrame(columns).write_csv(path, separator=separator)

    return write


def write_parquet(path: Path, columns: Columns) -> None:
    pl.DataFrame(columns).write_parquet(path)


WRITERS: dict[str, Callable[[Path, Columns], None]] = {
    ".csv": write_text(","),
    ".tsv": write_text("\t"),
    ".txt": write_text(";"),
    ".parquet": write_parquet,
}
COLUMNS: Columns = {"t": [0.0, 0.01, 0.02], "q_a": [0.1, -2.5e-17, 1 / 3], "tau_a": [1e300, 2.0, 3.0]}


@pytest.fixture(params=sorted(READERS))
def suffix(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_reads_every_column_exactly_and_in_order(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    WRITERS[suffix](path, COLUMNS)
    table = read_table(path)
    assert list(table.columns) == list(COLUMNS)
    for name, values in COLUMNS.items():
        np.testing.assert_array_equal(table.columns[name], values)
        assert table.columns[name].dtype == np.float64
    assert table.repairs == ()


def test_upper_case_suffixes_are_known(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"RUN{suffix.upper()}"
    WRITERS[suffix](path, COLUMNS)
    assert list(read_table(path).columns) == list(COLUMNS)


def test_unreadable_cells_become_nan(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    WRITERS[suffix](path, {"t": [0.0, 1.0, 2.0], "q": [None, math.nan, math.inf]})
    np.testing.assert_array_equal(read_table(path).columns["q"], [np.nan, np.nan, np.inf])


@pytest.mark.parametrize("content", [b"", bytes(range(256)) * 64, b"\x00" * 4096])
def test_empty_and_foreign_files_are_refused(suffix: str, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    path.write_bytes(content)
    with pytest.raises(DataError) as problem:
        read_table(path)
    assert str(path) in str(problem.value)
    assert problem.value.next_step


def test_files_cut_anywhere_give_an_error_or_whole_rows(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    WRITERS[suffix](path, COLUMNS)
    data = path.read_bytes()
    for size in range(0, len(data), max(1, len(data) // 40)):
        path.write_bytes(data[:size])
        try:
            table = read_table(path)
        except DataError:
            continue
        for name, values in table.columns.items():
            np.testing.assert_array_equal(values, COLUMNS[name][: len(values)])


def test_a_missing_file_is_named(suffix: str, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such log file"):
        read_table(tmp_path / f"gone{suffix}")


def test_every_reader_is_tested() -> None:
    assert set(WRITERS) == set(READERS)
