"""Rows: what is dropped, what is refused, and that every repair is on record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from log_examples import MOTION, SPEC, make_log

from etude.errors import DataError
from etude.logs.derivatives import segments
from etude.logs.doctor import increasing_rows, take_rows
from etude.logs.log import RobotLog
from etude.logs.read import clean_log

LOG = make_log()


def with_cells(cells: list[tuple[int, int, float]], channel: str = "q") -> RobotLog:
    values = getattr(LOG, channel).copy()
    for row, column, value in cells:
        values[row, column] = value
    return replace(LOG, **{channel: values})


def test_a_good_log_passes_untouched() -> None:
    assert clean_log(LOG, SPEC) == LOG


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("channel", ["q", "tau"])
def test_rows_with_bad_cells_are_dropped_not_filled(value: float, channel: str) -> None:
    log = clean_log(with_cells([(5, 1, value), (70, 0, value)], channel), SPEC)
    np.testing.assert_array_equal(log.t, np.delete(LOG.t, [5, 70]))
    np.testing.assert_array_equal(log.q, np.delete(LOG.q, [5, 70], axis=0))
    assert log.repairs == (
        f"2 rows with empty, NaN or infinite cells (most in {channel} of joint pan_joint) were dropped.",
    )


def test_a_log_of_mostly_bad_cells_is_refused() -> None:
    with pytest.raises(DataError, match=r"1500 of 2000 rows have empty.*tau of joint elbow_joint"):
        clean_log(with_cells([(i, 2, np.nan) for i in range(1500)], "tau"), SPEC)


def test_an_optional_channel_without_numbers_goes() -> None:
    log = clean_log(replace(LOG, qd=np.full_like(LOG.q, np.nan)), SPEC)
    assert log.qd is None
    assert "Channel qd has a column without numbers" in log.repairs[0]


def test_repeated_times_are_dropped() -> None:
    index = np.repeat(np.arange(len(LOG.t)), 2)
    log = clean_log(take_rows(LOG, index), SPEC)
    np.testing.assert_array_equal(log.t, LOG.t)
    assert log.repairs == ("2000 rows that repeat the time before were dropped.",)


@pytest.mark.parametrize("wrong", [0.0, -3.0, 1e9])
def test_single_wrong_stamps_are_dropped(wrong: float) -> None:
    t = LOG.t.copy()
    t[700] = wrong
    log = clean_log(replace(LOG, t=t), SPEC)
    np.testing.assert_array_equal(log.t, np.delete(LOG.t, 700))
    assert log.repairs == ("1 rows whose time jumps or runs backwards were dropped.",)


def test_two_recordings_in_one_file_are_refused() -> None:
    twice = take_rows(LOG, np.concatenate([np.arange(2000), np.arange(2000)]))
    with pytest.raises(DataError, match=r"time restarts at row 2000.*Cut the file there"):
        clean_log(twice, SPEC)


def test_shuffled_rows_are_refused() -> None:
    order = np.random.default_rng(1).permutation(2000)
    with pytest.raises(DataError, match=r"time runs backwards .* times.*Sort it by time"):
        clean_log(take_rows(LOG, order), SPEC)


def test_a_stopped_clock_is_refused() -> None:
    with pytest.raises(DataError, match="the time never advances"):
        clean_log(replace(LOG, t=np.full(2000, 3.0)), SPEC)


@given(st.lists(st.integers(-20, 20), min_size=1, max_size=40))
def test_longest_increasing_run(values: list[int]) -> None:
    t = np.array(values, dtype=float)
    rows = increasing_rows(t)
    assert (np.diff(rows) > 0).all()
    assert (np.diff(t[rows]) > 0).all()
    best = [1] * len(values)  # the textbook's quadratic recursion
    for i in range(len(values)):
        best[i] = 1 + max((best[j] for j in range(i) if values[j] < values[i]), default=0)
    assert len(rows) == max(best)


def test_pauses_split_the_log() -> None:
    keep = (LOG.t < 5) | (LOG.t > 7)
    log = clean_log(take_rows(LOG, keep), SPEC)
    assert [piece.stop - piece.start for piece in segments(log.t)] == [500, 1299]
    assert "1 pauses without samples" in log.repairs[0]
    assert "after t = 4.99" in log.repairs[0]


def test_mostly_pauses_is_refused() -> None:
    keep = (LOG.t < 2) | (LOG.t > 15)
    with pytest.raises(DataError, match=r"samples are missing for 13 of 20 s.*after t = 1.99"):
        clean_log(take_rows(LOG, keep), SPEC)


def test_single_wild_positions_are_dropped() -> None:
    log = clean_log(with_cells([(300, 1, 55.0), (900, 0, -0.9)]), SPEC)
    np.testing.assert_array_equal(log.t, np.delete(LOG.t, [300, 900]))
    assert log.repairs == ("2 rows with a single wild position were dropped.",)


@pytest.mark.parametrize(("jump", "advice"), [(0.68, "several recordings"), (-2 * np.pi, "Unwrap")])
def test_a_lasting_jump_is_refused(jump: float, advice: str) -> None:
    q = LOG.q.copy()
    q[1000:1040, 2] += jump
    with pytest.raises(
        DataError, match=rf"jumps by {str(jump)[:2]}.* rad at t = 9.99\d s.*elbow_joint.*{advice}"
    ):
        clean_log(replace(LOG, q=q), SPEC)


def test_constant_columns() -> None:
    still = LOG.q.copy()
    still[:, 0] = 0.1
    log = clean_log(replace(LOG, q=still), SPEC)
    assert log.repairs == ("Joint pan_joint did not move in this log.",)
    with pytest.raises(DataError, match=r"command is constant \(0\) although the joint moved.*lift_joint"):
        clean_log(with_cells([(i, 1, 0.0) for i in range(2000)], "tau"), SPEC)
    with pytest.raises(DataError, match="no joint moved"):
        clean_log(replace(LOG, q=np.full_like(LOG.q, 0.1)), SPEC)


def test_too_short() -> None:
    with pytest.raises(DataError, match="only 40 usable rows"):
        clean_log(take_rows(LOG, np.arange(40)), SPEC)


def test_lead_in_keeps_its_negative_time() -> None:
    log = make_log(start=-2.0)
    assert clean_log(log, SPEC).t[0] == -2.0
    late = clean_log(replace(LOG, t=LOG.t + 1.7e9), SPEC)
    np.testing.assert_allclose(late.t, LOG.t, atol=1e-6)
    assert late.repairs == ("Time begins at 1700000000.000 s and was shifted to 0.",)
    assert MOTION.duration == 20.0
