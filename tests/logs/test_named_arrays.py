"""Joint states as arrays: names beside decide, whatever their order; without names their count has to fit."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from log_examples import CHANNELS, JOINTS, LIMITS, RATE, make_log

from etude.errors import DataError
from etude.logs import read_log
from etude.types import Log

LOG = make_log()
ORDER = (2, 0, 1)
ROWS = len(LOG)


def read(path: Path) -> Log:
    return read_log(path, CHANNELS, rate=RATE, limits=LIMITS)


def assert_right(log: Log) -> None:
    np.testing.assert_array_equal(log["q"], LOG["q"])
    np.testing.assert_array_equal(log["command"], LOG["command"])


def written(path: Path, frame: pl.DataFrame) -> Path:
    frame.write_parquet(path) if path.suffix == ".parquet" else frame.write_csv(path)
    return path


def entries(pattern: str, names: str) -> pl.DataFrame:
    """A column for each entry, in another order than the robot's."""
    table: dict[str, object] = {"t": LOG.t}
    for i, j in enumerate(ORDER):
        table[names.format(i)] = [JOINTS[j]] * ROWS
        table[pattern.format("position", i)] = LOG["q"][:, j]
        table[pattern.format("effort", i)] = LOG["command"][:, j]
    return pl.DataFrame(table)


def lists(names: str = "name") -> pl.DataFrame:
    """A column of lists for each signal, in an order that changes from row to row."""
    orders = [np.roll(ORDER, row % 3) for row in range(ROWS)]
    return pl.DataFrame(
        {
            "t": LOG.t,
            names: [[JOINTS[j] for j in order] for order in orders],
            "position": [LOG["q"][row, order].tolist() for row, order in enumerate(orders)],
            "effort": [LOG["command"][row, order].tolist() for row, order in enumerate(orders)],
        }
    )


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize(
    ("pattern", "names"),
    [
        ("{}[{}]", "name[{}]"),
        ("field.{}{}", "field.name{}"),
        ("/joint_states/{}.{}", "/joint_states/name.{}"),
        ("{}_{}", "joint_names_{}"),
    ],
)
def test_names_beside_numbers_decide(pattern: str, names: str, suffix: str, tmp_path: Path) -> None:
    """Of 0.1 these were taken in the robot's order."""
    log = read(written(tmp_path / f"run{suffix}", entries(pattern, names)))
    assert_right(log)
    assert any("mapped to joints by the names in the same row" in sentence for sentence in log.repairs)


@pytest.mark.parametrize("dtype", [pl.Categorical, pl.String])
def test_names_may_be_categories(dtype: type[pl.DataType], tmp_path: Path) -> None:
    frame = entries("{}[{}]", "name[{}]")
    frame = frame.with_columns(pl.col("^name.*$").cast(dtype))
    assert_right(read(written(tmp_path / "run.parquet", frame)))


def test_lists_are_mapped_by_their_names(tmp_path: Path) -> None:
    assert_right(read(written(tmp_path / "run.parquet", lists())))
    fixed = lists().with_columns(pl.col("position").list.to_array(3), pl.col("name").list.to_array(3))
    assert_right(read(written(tmp_path / "fixed.parquet", fixed)))


def test_a_struct_of_lists_is_mapped_too(tmp_path: Path) -> None:
    nested = lists().select("t", pl.struct("name", "position", "effort").alias("joint_states"))
    assert_right(read(written(tmp_path / "run.parquet", nested)))


def test_lists_in_text_cells(tmp_path: Path) -> None:
    frame = lists()
    for column in ("name", "position", "effort"):
        frame = frame.with_columns(pl.Series(column, [str(cell) for cell in frame[column].to_list()]))
    assert_right(read(written(tmp_path / "run.csv", frame)))


def unnamed(width: int = 3) -> pl.DataFrame:
    """Lists in the robot's order, without names, of which the last is `ee` or whatever."""
    values = {word: np.pad(LOG[c], ((0, 0), (0, width - 3))) for word, c in SIGNALS.items()}
    return pl.DataFrame({"t": LOG.t, **{word: rows.tolist() for word, rows in values.items()}})


SIGNALS = {"position": "q", "effort": "command"}


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_lists_without_names_are_in_the_robots_order_if_they_are_as_many(suffix: str, tmp_path: Path) -> None:
    frame = unnamed()
    if suffix == ".csv":
        frame = frame.with_columns(
            pl.Series(w, [f"array('d', {c})" for c in frame[w].to_list()]) for w in SIGNALS
        )
    log = read(written(tmp_path / f"run{suffix}", frame))
    assert_right(log)
    said = " ".join(log.repairs)
    assert "Columns position, effort hold lists without names; their entries were numbered from 0." in said
    assert "were read as pan_joint, lift_joint, elbow_joint, in this order" in said


def test_lists_without_names_of_another_count_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"numbered 0, 1, 2, 3, which are not the 3 parts"):
        read(written(tmp_path / "run.parquet", unnamed(4)))


def test_lists_without_names_whose_length_changes_say_nothing(tmp_path: Path) -> None:
    frame = unnamed()
    cells = [cell[: 2 + row % 2] for row, cell in enumerate(frame["position"].to_list())]
    with pytest.raises(
        DataError, match=r"no column for channel 'q'.*position hold lists without numbers or with too many"
    ):
        read(written(tmp_path / "run.parquet", frame.with_columns(pl.Series("position", cells))))


def test_a_list_without_names_that_is_cut_in_a_row_costs_that_row(tmp_path: Path) -> None:
    frame = unnamed()
    cells = frame["position"].to_list()
    cells[40] = cells[40][:1]
    log = read(written(tmp_path / "run.parquet", frame.with_columns(pl.Series("position", cells))))
    np.testing.assert_array_equal(log.t, np.delete(LOG.t, 40))


def test_a_missing_name_is_refused(tmp_path: Path) -> None:
    frame = entries("{}[{}]", "name[{}]").drop("name[1]")
    with pytest.raises(DataError, match="no column for channel 'q' of pan_joint"):
        read(written(tmp_path / "run.csv", frame))
    other = entries("{}[{}]", "name[{}]").with_columns(pl.lit("gripper").alias("name[0]"))
    with pytest.raises(DataError, match="of elbow_joint"):
        read(written(tmp_path / "run.csv", other))


def test_a_name_that_stands_twice_is_refused(tmp_path: Path) -> None:
    twice = entries("{}[{}]", "name[{}]").with_columns(pl.lit("pan_joint").alias("name[0]"))
    with pytest.raises(DataError, match="'pan_joint' occurs twice"):
        read(written(tmp_path / "run.csv", twice))


def test_a_list_that_is_too_short_in_a_row_costs_that_row(tmp_path: Path) -> None:
    frame = lists()
    cells = frame["position"].to_list()
    cells[40] = cells[40][:1]
    log = read(written(tmp_path / "run.parquet", frame.with_columns(pl.Series("position", cells))))
    np.testing.assert_array_equal(log.t, np.delete(LOG.t, 40))


def plain() -> pl.DataFrame:
    table = {
        f"{w}_{j}": LOG[c][:, k] for w, c in (("q", "q"), ("tau", "command")) for k, j in enumerate(JOINTS)
    }
    return pl.DataFrame({"t": LOG.t, **table})


@pytest.mark.parametrize("dtype", [pl.Float32, pl.Decimal(20, 12), pl.String, pl.Binary])
def test_columns_of_other_types_are_numbers_where_they_hold_some(dtype: object, tmp_path: Path) -> None:
    cells = [Decimal(f"{value:.12f}") for value in plain()["q_pan_joint"].to_list()]
    series = pl.Series("q_pan_joint", cells)
    if dtype == pl.Float32:
        series = series.cast(pl.Float32)
    elif dtype != pl.Decimal(20, 12):
        series = pl.Series("q_pan_joint", [str(cell) for cell in cells]).cast(dtype)  # type: ignore[arg-type]
    log = read(written(tmp_path / "run.parquet", plain().with_columns(series)))
    np.testing.assert_allclose(log["q"], LOG["q"], atol=1e-6)


@pytest.mark.parametrize(
    "column",
    [
        pl.Series([["a", "b"]] * ROWS),
        pl.Series(["low", "high"] * (ROWS // 2)).cast(pl.Categorical),
        pl.Series([b"\xff\x00"] * ROWS),
        pl.Series([None] * ROWS),
        pl.Series([{"a": [1]}] * ROWS),
        pl.Series([[[1.0]]] * ROWS),
    ],
    ids=["lists", "categories", "bytes", "nothing", "structs", "lists of lists"],
)
def test_columns_without_numbers(column: pl.Series, tmp_path: Path) -> None:
    """Beside the others they are ignored; categories are not taken for their codes."""
    assert_right(read(written(tmp_path / "run.parquet", plain().with_columns(column.alias("state")))))
    with pytest.raises(DataError):
        read(written(tmp_path / "bad.parquet", plain().with_columns(column.alias("q_pan_joint"))))
