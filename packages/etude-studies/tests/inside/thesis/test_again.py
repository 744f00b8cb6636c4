"""What is computed again is held against what is committed, seed by seed and figure by figure."""

from __future__ import annotations

from dataclasses import replace

import polars as pl
import pytest

from etude_studies.collected import Results
from etude_studies.thesis.again import again
from etude_studies.thesis.kept import kept_results

RUN = "B1"


def changed(**columns: pl.Expr) -> Results:
    kept = kept_results()
    return replace(kept, tables={RUN: kept.tables[RUN].with_columns(**columns)})


def test_the_committed_ones_are_the_same() -> None:
    found = again(RUN, [0, 1], kept_results(), kept_results())
    assert found is not None
    assert (found.seeds, found.largest, found.missing) == ((0, 1), 0.0, 0)
    assert found.figures > 0
    assert "the same as those committed" in found.sentence


def test_how_far_is_relative_to_the_larger_and_of_the_asked_seeds_alone() -> None:
    here = changed(value=pl.when(pl.col("seed") == 1).then(2.0 * pl.col("value")).otherwise(pl.col("value")))
    both, first = (again(RUN, seeds, here, kept_results()) for seeds in ([0, 1], [0]))
    assert first is not None
    assert first.largest == 0.0
    assert both is not None
    assert both.largest == pytest.approx(0.5)
    assert both.mean == pytest.approx(0.25, abs=0.02)
    assert both.commits in both.sentence


def test_a_figure_of_one_of_both_is_counted() -> None:
    whole = kept_results()
    error = (pl.col("measure") == "error") & (pl.col("part") == "mean")
    less = replace(whole, tables={RUN: whole.tables[RUN].filter(~error)})
    lost = len(whole.tables[RUN].filter(error, pl.col("seed") == 0, pl.col("value").is_finite()))
    found = again(RUN, [0], less, whole)
    assert found is not None
    assert found.missing == lost > 0
    assert f"{lost} that only one" in found.sentence


def test_times_are_no_difference() -> None:
    late = pl.col("measure").str.starts_with("cpu_")
    here = changed(value=pl.when(late).then(pl.lit(1e6)).otherwise(pl.col("value")))
    found = again(RUN, [0], here, kept_results())
    assert found is not None
    assert found.largest == 0.0


def test_nothing_to_compare() -> None:
    assert again(RUN, [999], kept_results(), kept_results()) is None
    assert again("a user's own", [0], kept_results(), kept_results()) is None
