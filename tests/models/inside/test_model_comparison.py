"""Is a model better: the interval of a ratio paired by segment, coverage, and what was left out as a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm, ttest_1samp

from etude.errors import DataError
from etude.models import read_residuals
from etude.models.accuracy import NARROW, WIDE, by_segment, compared, coverage, uncalibrated
from etude.models.config import LEAST_SEGMENTS
from etude.models.selection.model_selection import CrossValidationResiduals


def test_the_interval_is_students_t_of_the_mean_log_ratio() -> None:
    rng = np.random.default_rng(3)
    own, other = np.exp(rng.normal(-0.3, 0.2, (7, 3))), np.exp(rng.normal(0.0, 0.1, (7, 3)))
    found = compared("it", own, other)
    logs = np.log(own / other).mean(axis=1)
    expected = np.exp(ttest_1samp(logs, 0.0).confidence_interval(0.95))
    np.testing.assert_allclose([found.lower, found.upper], expected, rtol=1e-12)
    assert found.ratio == pytest.approx(np.exp(logs.mean()))
    np.testing.assert_allclose(found.by_command, np.exp(np.log(own / other).mean(axis=0)))


@pytest.mark.parametrize(
    ("ratios", "decision"),
    [
        ([0.5, 0.55, 0.45], "not decided"),
        ([0.5, 0.55, 0.45, 0.5], "better"),
        ([0.5, 0.9, 0.3, 2.5], "not decided"),
        ([0.95, 1.5, 1.2, 1.9], "not decided"),
        ([1.0, 1.0, 1.0, 1.0], "level"),
        ([0.95, 1.05, 0.97, 1.0], "level"),
        ([1.2, 1.21, 1.2, 1.21], "not better"),
        ([], "not decided"),
    ],
)
def test_few_segments_and_an_interval_about_one_decide_nothing(ratios: list[float], decision: str) -> None:
    assert LEAST_SEGMENTS == 4
    assert compared("it", np.array(ratios)[:, None], np.ones((len(ratios), 1))).decision == decision


def test_a_command_that_said_nothing_in_a_segment_does_not_count_there() -> None:
    own = np.array([[0.5, np.nan], [0.5, 2.0], [np.nan, np.nan]])
    found = compared("it", own, np.ones_like(own))
    assert found.segments == 2
    assert found.ratio == pytest.approx(np.sqrt(0.5))
    assert found.by_command == pytest.approx((0.5, 2.0))


def test_errors_are_root_mean_squares_of_each_segment() -> None:
    error = np.array([[3.0, 1.0], [4.0, np.nan], [1.0, 1.0]])
    found = by_segment(error, np.array([7, 7, 9]), [7, 9, 11])
    np.testing.assert_allclose(found, [[np.sqrt(12.5), 1.0], [1.0, 1.0], [np.nan, np.nan]])


def test_coverage_of_right_narrow_and_wide_intervals() -> None:
    error = norm.ppf((np.arange(2000) + 0.5) / 2000)[:, None] * np.ones(3)
    narrow, wide = coverage(error, np.array([1.0, 0.3, 16.0]) * np.ones_like(error))
    assert (narrow[0], wide[0]) == pytest.approx((0.5, 0.95), abs=1e-3)
    assert uncalibrated(wide) == [1]
    assert pytest.approx((norm.ppf(0.75), norm.ppf(0.975)), rel=1e-14) == (NARROW, WIDE)


def test_what_was_left_out_comes_back_and_damage_is_told(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    values = [rng.normal(size=(5, 2)) for _ in range(3)]
    kept = CrossValidationResiduals(np.arange(5), np.array([0, 0, 1, 1, 1]), *values, "linear")
    path = tmp_path / "left_out.npz"
    path.write_bytes(kept.to_bytes())
    again = read_residuals(path)
    for name in ("rows", "group", "error", "variance", "physics"):
        np.testing.assert_array_equal(getattr(again, name), getattr(kept, name))
    assert again.structure == "linear"
    assert again.to_bytes() == kept.to_bytes()
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(DataError, match="cannot be read"):
        read_residuals(path)
