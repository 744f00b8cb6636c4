"""Measurements of a run: figures with their keys, and the table that keeps them."""

from __future__ import annotations

from collections.abc import Iterable
from operator import index
from typing import TYPE_CHECKING, Any, NamedTuple

from etude.errors import DataError

if TYPE_CHECKING:
    import polars as pl

KEYS = ("k", "test", "model", "part", "measure")
TIMES = "cpu_"
"""Measures whose names begin so are times: two computations of one run agree but for them."""


class Measured(NamedTuple):
    """One measured figure.

    Attributes:
        k: trajectories learned before it was measured, or what else the figure is a function of.
        test: set of tests; "" of the model itself.
        model: line beside the run's own model; "" for its own.
        part: joint, command, or "mean".
        measure: its name, "error", "variance", ...
        value: kept in single precision; NaN where it could not be measured.
    """

    k: int
    test: str
    model: str
    part: str
    measure: str
    value: float


def schema() -> pl.Schema:
    """Columns of a table of measurements."""
    import polars as pl

    texts = dict.fromkeys(KEYS[1:], pl.String)
    return pl.Schema({"k": pl.Int32, **texts, "value": pl.Float32})


def measured_table(measurements: object, source: str) -> pl.DataFrame:
    """Measurements as a table of `schema()`, sorted.

    Raises:
        DataError: something in it is no `Measured`, or the same figure stands in it twice.
    """
    import polars as pl

    rows = (
        [_checked(measurement, source) for measurement in measurements]
        if isinstance(measurements, Iterable)
        else []
    )
    if not rows:
        raise _refused(f"it returned {type(measurements).__name__} with nothing measured in it", source)
    table = pl.DataFrame(rows, schema={**schema(), "value": pl.Float64}, orient="row").cast(schema())
    twice = table.filter(table.select(KEYS).is_duplicated())
    if len(twice):
        raise _refused(f"it measured {twice.row(0)[:-1]} twice", source)
    return table.sort(KEYS)


def _checked(measurement: Any, source: str) -> tuple[Any, ...]:
    try:
        k, *texts, value = measurement
        if len(texts) == 4 and all(isinstance(text, str) for text in texts):
            return index(k), *texts, float(value)
    except (TypeError, ValueError):
        pass
    raise _refused(f"it returned {measurement!r}, which is no measurement", source)


def _refused(fact: str, source: str) -> DataError:
    return DataError(fact, where=source, next_step="Return a list of Measured, each figure once.")


def comparable(table: pl.DataFrame) -> pl.DataFrame:
    """The table without times: equal for every computation of the same run by the same code."""
    import polars as pl

    if "measure" not in table.columns:
        return table
    return table.filter(~pl.col("measure").str.starts_with(TIMES))
