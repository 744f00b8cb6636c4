"""What every log reader must do; a new table needs one row in WRITERS."""

from __future__ import annotations

import contextlib
import math
import random
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from damage import damaged

from etude.errors import DataError
from etude.logs import read_log, read_raw
from etude.logs.readers.registry import READERS, read_csv, read_parquet
from etude.testing import ReaderSuite
from etude.types import Channel

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


@pytest.fixture(params=sorted(WRITERS))
def suffix(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_reads_every_column_exactly_and_in_order(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    WRITERS[suffix](path, COLUMNS)
    table = read_raw(path)
    assert list(table.values) == list(COLUMNS)
    for name, values in COLUMNS.items():
        np.testing.assert_array_equal(table[name][:, 0], values)
        assert table[name].dtype == np.float64
    assert table.repairs == ()


def test_upper_case_suffixes_are_known(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"RUN{suffix.upper()}"
    WRITERS[suffix](path, COLUMNS)
    assert list(read_raw(path).values) == list(COLUMNS)


def test_unreadable_cells_become_nan(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    WRITERS[suffix](path, {"t": [0.0, 1.0, 2.0], "q": [None, math.nan, math.inf]})
    np.testing.assert_array_equal(read_raw(path)["q"][:, 0], [np.nan, np.nan, np.inf])


@pytest.mark.parametrize("content", [b"", bytes(range(256)) * 64, b"\x00" * 4096])
def test_empty_and_foreign_files_are_refused(suffix: str, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    path.write_bytes(content)
    with pytest.raises(DataError) as problem:
        read_raw(path)
    assert str(path) in str(problem.value)
    assert problem.value.next_step


def test_files_cut_anywhere_give_an_error_or_whole_rows(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    WRITERS[suffix](path, COLUMNS)
    data = path.read_bytes()
    for size in range(0, len(data), max(1, len(data) // 40)):
        path.write_bytes(data[:size])
        try:
            table = read_raw(path)
        except DataError:
            continue
        for name, values in table.values.items():
            np.testing.assert_array_equal(values[:, 0], COLUMNS[name][: len(values)])


def test_a_missing_file_is_named(suffix: str, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such log file"):
        read_raw(tmp_path / f"gone{suffix}")


CHANNELS = (
    Channel("q", ("a", "b"), ("rad", "rad"), required=True),
    Channel("command", ("a", "b"), ("N m", "N m"), "command", required=True, acts_on="q"),
)
LIMITS = {"q": (np.array([-2.0, -2.0]), np.array([2.0, 2.0]))}


def whole_log() -> Columns:
    t = np.arange(300) / 100
    names = (("q", "a"), ("q", "b"), ("tau", "a"), ("tau", "b"))
    signals = {f"{w}_{p}": np.sin(t * k) for k, (w, p) in enumerate(names, 1)}
    return {name: values.tolist() for name, values in ({"t": t} | signals).items()}


def test_damaged_files_give_an_error_or_a_log_within_a_second(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    WRITERS[suffix](path, whole_log())
    data = path.read_bytes()
    assert len(read_log(path, CHANNELS, rate=100.0, limits=LIMITS)) == 300
    for number in range(30):
        path.write_bytes(damaged(data, random.Random(number)))
        began = time.perf_counter()
        with contextlib.suppress(DataError):
            log = read_log(path, CHANNELS, rate=100.0, limits=LIMITS)
            assert np.isfinite(log["q"]).all(), number
        assert time.perf_counter() - began < 1.0, number


def test_counts_that_are_not_true_do_not_end_the_program(tmp_path: Path) -> None:
    """polars asks for 2^61 bytes where a page counts -58 values, and no exception tells of it: so our own
    check comes first (docs/decisions/0055-matlab-files.md)."""
    path = tmp_path / "run.parquet"
    frame = pl.DataFrame({"t": np.arange(50) / 100})
    frame.write_parquet(path, compression="uncompressed", statistics=False)
    data = path.read_bytes()
    count = b"\x2c\x15\x64"  # a page's own header, and 50 in zigzag as its first field
    assert count in data
    path.write_bytes(data.replace(count, b"\x2c\x15\x73", 1))
    with pytest.raises(DataError, match="cannot be read as Parquet"):
        read_raw(path)
    alone = "import sys, polars\ntry: polars.read_parquet(sys.argv[1])\nexcept BaseException: pass"
    done = subprocess.run([sys.executable, "-c", alone, str(path)], capture_output=True, check=False)
    assert done.returncode != 0, "polars refuses it by itself: look at the record again"
    assert b"memory allocation" in done.stderr


class TestCsv(ReaderSuite):
    reader, suffix = staticmethod(read_csv), ".csv"

    def write(self, path: Path, columns: dict[str, list[float]]) -> None:
        WRITERS[".csv"](path, dict(columns))


class TestParquet(ReaderSuite):
    reader, suffix = staticmethod(read_parquet), ".parquet"

    def write(self, path: Path, columns: dict[str, list[float]]) -> None:
        WRITERS[".parquet"](path, dict(columns))


def test_every_table_is_tested() -> None:
    """What is no table is in test_damaged_logs.py."""
    assert set(WRITERS) == {suffix for suffix, name in READERS.items() if name in ("csv", "parquet")}
