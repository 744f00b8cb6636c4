"""Compiled loops do what the same functions do in Python; code on disk is used again, never a damaged one."""

from __future__ import annotations

import importlib

import numpy as np
import pytest

from etude._runtime.loop_compiler import Part, loops
from etude.types import Array

COLUMNS = 8
WEIGHTS, START = 2.5, 1
START_ROW = START + 1


@Part
def scaled(work: Array, row: int, factor: float) -> float:
    """Row times a factor; its sum."""
    total = 0.0
    for x in range(COLUMNS):
        work[row, x] = factor * work[row, x] if work[row, x] > 0.0 else -work[row, x] / WEIGHTS
        total += work[row, x]
    return total


def every_statement(work: Array, tensor: Array, count: int, back: int, out: Array) -> None:
    """All that the subset has."""
    rows, last = work.shape[0], count - 1
    at = START
    at = at + START_ROW % 2
    for row in range(at, rows):
        if row == last:
            continue
        factor = 0.5 * row
        if back:
            factor = abs(tensor[0, row % 2, 1] - factor)
        else:
            factor -= min(row, count) / 2
        out[row] += scaled(work, row, factor)
    for row in range(rows - 1, -1, -1):
        before = row if row < 1 else row - 1
        out[row] += out[before] * (row // 2)
    for row in range(0, rows, 2):
        first, second = work[row, 0], work[row, 1]
        work[row, 0], work[row, 1] = second, first


compiled = loops({"work": COLUMNS})(every_statement)


def inputs(seed: int) -> tuple[Array, Array, Array]:
    draw = np.random.default_rng(seed)
    return draw.standard_normal((6, COLUMNS)), draw.standard_normal((1, 2, 3)), np.zeros(6)


@pytest.mark.parametrize("back", [0, 1])
@pytest.mark.parametrize("count", [2, 5, 9])
def test_a_compiled_function_does_what_python_does(count: int, back: int) -> None:
    work, tensor, out = inputs(count)
    expected_work, expected_out = work.copy(), out.copy()
    every_statement(expected_work, tensor, count, back, expected_out)
    compiled(work, tensor, count, back, out)
    np.testing.assert_allclose(work, expected_work, rtol=1e-14)
    np.testing.assert_allclose(out, expected_out, rtol=1e-14)
    assert np.abs(out[2:]).min() > 0.0


@pytest.mark.parametrize(
    "wrong", [lambda a: a.astype(np.float32), lambda a: a[:, ::2], np.asfortranarray, lambda a: a.astype(int)]
)
def test_arrays_of_another_kind_are_refused(wrong) -> None:
    work, tensor, out = inputs(0)
    with pytest.raises(TypeError, match="every_statement takes C-contiguous arrays of doubles"):
        compiled(wrong(work), tensor, 2, 0, out)


def with_a_list(work: Array) -> None:
    work[0, 0] = sum([1.0, 2.0])


def with_a_while(work: Array) -> None:
    while work[0, 0] > 1.0:
        work[0, 0] *= 0.5


@pytest.mark.parametrize(
    ("function", "named"), [(with_a_list, r"\[1.0, 2.0\]"), (with_a_while, "while work")]
)
def test_what_the_subset_lacks_is_named(function, named: str) -> None:
    with pytest.raises(SyntaxError, match=named):
        loops()(function)(np.zeros((1, 1)))


def test_the_code_on_disk_is_used_again_and_a_damaged_one_is_not(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    loops({"work": COLUMNS})(every_statement)(*inputs(0)[:2], 2, 0, inputs(0)[2])
    (file,) = tmp_path.iterdir()
    whole, made = file.read_bytes(), file.stat().st_ino
    again = inputs(1)
    loops({"work": COLUMNS})(every_statement)(*again[:2], 2, 0, again[2])
    assert [p.stat().st_ino for p in tmp_path.iterdir()] == [made]
    file.write_bytes(whole[:40] + b"\xcc" + whole[41:])
    other = inputs(1)
    loops({"work": COLUMNS})(every_statement)(*other[:2], 2, 0, other[2])
    np.testing.assert_array_equal(other[2], again[2])
    assert file.read_bytes() == whole


def test_without_a_folder_that_can_be_written_it_compiles_each_time(tmp_path, monkeypatch) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(blocked / "below"))
    work, tensor, out = inputs(3)
    expected = out.copy()
    every_statement(work.copy(), tensor, 2, 1, expected)
    loops({"work": COLUMNS})(every_statement)(work, tensor, 2, 1, out)
    np.testing.assert_allclose(out, expected, rtol=1e-14)


OTHER = """
from etude._runtime.loop_compiler import loops
from etude.types import Array

@loops()
def doubled(work: Array) -> None:
    for i in range(work.shape[0]):
        work[i] = 2.0 * work[i]
"""


def test_where_the_installation_cannot_be_written_the_users_folder_keeps_it(tmp_path, monkeypatch) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "own"))
    (tmp_path / "other_loops.py").write_text(OTHER)
    (tmp_path / "__pycache__").write_text("no folder")
    monkeypatch.syspath_prepend(tmp_path)
    values = np.arange(3.0)
    importlib.import_module("other_loops").doubled(values)
    np.testing.assert_array_equal(values, [0.0, 2.0, 4.0])
    (kept,) = (tmp_path / "own" / "etude").iterdir()
    assert kept.suffix == ".o"
