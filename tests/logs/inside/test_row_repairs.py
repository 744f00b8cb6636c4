"""Rows: what is dropped, what is refused, and that every repair is on record."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from log_examples import CHANNELS, JOINTS, LIMITS, MOTION, at, make_log, with_values

from etude.errors import DataError
from etude.logs import clean_log
from etude.logs.cleaning.filters import segments
from etude.logs.cleaning.repairs import increasing_rows
from etude.logs.columns.units import start_at_zero
from etude.types import Channel, Log

LOG = make_log()


def cleaned(log: Log) -> Log:
    return start_at_zero(clean_log(log, CHANNELS, LIMITS))


def with_cells(cells: list[tuple[int, int, float]], channel: str = "q") -> Log:
    values = LOG[channel].copy()
    for row, column, value in cells:
        values[row, column] = value
    return with_values(LOG, **{channel: values})


def test_a_good_log_passes_untouched() -> None:
    assert cleaned(LOG) is LOG


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("channel", ["q", "command"])
def test_rows_with_bad_cells_are_dropped_not_filled(value: float, channel: str) -> None:
    log = cleaned(with_cells([(5, 1, value), (70, 0, value)], channel))
    np.testing.assert_array_equal(log.t, np.delete(LOG.t, [5, 70]))
    np.testing.assert_array_equal(log["q"], np.delete(LOG["q"], [5, 70], axis=0))
    assert log.repairs == (
        f"Dropped 2 rows with empty, NaN or infinite cells (most in {channel} of pan_joint).",
    )


def test_a_log_of_mostly_bad_cells_is_refused() -> None:
    with pytest.raises(DataError, match=r"1500 of 2000 rows have empty.*command of elbow_joint"):
        cleaned(with_cells([(i, 2, np.nan) for i in range(1500)], "command"))


def test_an_optional_channel_without_numbers_goes() -> None:
    log = cleaned(with_values(LOG, qd=np.full_like(LOG["q"], np.nan)))
    assert "qd" not in log
    assert "Channel qd has a column without numbers" in log.repairs[0]


def test_repeated_times_are_dropped() -> None:
    index = np.repeat(np.arange(len(LOG.t)), 2)
    log = cleaned(LOG.take(index))
    np.testing.assert_array_equal(log.t, LOG.t)
    assert log.repairs == ("Dropped 2000 rows with the time of the row before.",)


@pytest.mark.parametrize("wrong", [0.0, -3.0, 1e9])
def test_single_wrong_stamps_are_dropped(wrong: float) -> None:
    t = LOG.t.copy()
    t[700] = wrong
    log = cleaned(at(LOG, t))
    np.testing.assert_array_equal(log.t, np.delete(LOG.t, 700))
    assert log.repairs == ("Dropped 1 row whose time jumps or runs backwards.",)


def test_two_recordings_in_one_file_are_refused() -> None:
    twice = LOG.take(np.concatenate([np.arange(2000), np.arange(2000)]))
    with pytest.raises(DataError, match=r"time restarts at row 2000.*Cut the file there"):
        cleaned(twice)


def test_shuffled_rows_are_refused() -> None:
    order = np.random.default_rng(1).permutation(2000)
    with pytest.raises(DataError, match=r"time runs backwards .* times.*Sort it by time"):
        cleaned(LOG.take(order))


def test_a_stopped_clock_is_refused() -> None:
    with pytest.raises(DataError, match="the time never advances"):
        cleaned(at(LOG, np.full(2000, 3.0)))


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
    log = cleaned(LOG.take(keep))
    assert [piece.stop - piece.start for piece in segments(log.t)] == [500, 1299]
    assert "1 pauses without samples" in log.repairs[0]
    assert "after t = 4.99" in log.repairs[0]


@pytest.mark.parametrize("start", [1000.0, 1.7e9])
def test_stamps_that_were_not_set_yet_are_dropped(start: float) -> None:
    """The first rows of a recorder whose clock was not there; in order, so that sorting leaves them."""
    t = start + LOG.t
    t[:4] = [0.0, 0.79, 47.6, 48.0]
    log = cleaned(at(LOG, t))
    np.testing.assert_allclose(log.t, LOG.t[4:] - LOG.t[4], atol=1e-6)
    assert log.repairs[0] == "Dropped 4 rows far in time from all others (first at 0 s)."


def test_a_second_stretch_is_no_stray() -> None:
    t = LOG.t + 100.0 * (LOG.t > 18.0)
    with pytest.raises(DataError, match="samples are missing for 100"):
        cleaned(at(LOG, t))


def test_mostly_pauses_is_refused() -> None:
    keep = (LOG.t < 2) | (LOG.t > 15)
    with pytest.raises(DataError, match=r"samples are missing for 13 of 20 s.*after t = 1.99"):
        cleaned(LOG.take(keep))


def test_single_wild_positions_are_dropped() -> None:
    log = cleaned(with_cells([(300, 1, 55.0), (900, 0, -0.9)]))
    np.testing.assert_array_equal(log.t, np.delete(LOG.t, [300, 900]))
    assert log.repairs == ("Dropped 2 rows with a single outlier position.",)


def test_single_wild_positions_are_dropped_without_any_limit() -> None:
    wild = with_cells([(300, 1, float(LOG["q"][300, 1]) + 0.9)])
    assert len(clean_log(wild, CHANNELS)) == len(LOG) - 1


def test_the_flicker_of_an_encoder_at_rest_is_not_wild() -> None:
    q = LOG["q"].copy()
    q[200:, 1] = q[200, 1]
    q[[500, 700, 900], 1] += 0.001
    assert len(cleaned(with_values(LOG, q=q))) == len(LOG)


@pytest.mark.parametrize("jump", [0.68, -2 * np.pi])
def test_a_lasting_jump_is_refused(jump: float) -> None:
    q = LOG["q"].copy()
    q[1000:1040, 2] += jump
    with pytest.raises(
        DataError,
        match=rf"jumps by {str(jump)[:2]}.* rad at t = 9.99\d s.*elbow_joint.*several recordings",
    ):
        cleaned(with_values(LOG, q=q))


def test_constant_columns() -> None:
    still = LOG["q"].copy()
    still[:, 0] = 0.1
    log = cleaned(with_values(LOG, q=still))
    assert log.repairs == ("pan_joint did not move in this log.",)
    with pytest.raises(DataError, match="command of lift_joint is constant although the joint moved"):
        cleaned(with_cells([(i, 1, 0.0) for i in range(2000)], "command"))
    with pytest.raises(DataError, match="nothing moved"):
        cleaned(with_values(LOG, q=np.full_like(LOG["q"], 0.1)))


def test_too_short() -> None:
    with pytest.raises(DataError, match="only 40 usable rows"):
        cleaned(LOG.take(np.arange(40)))


def test_lead_in_keeps_its_negative_time() -> None:
    log = make_log(start=-2.0)
    assert cleaned(log).t[0] == -2.0
    late = cleaned(at(LOG, LOG.t + 1.7e9))
    np.testing.assert_allclose(late.t, LOG.t, atol=1e-6)
    assert late.repairs == ("Time begins at 1700000000.000 s and was shifted to 0.",)
    assert MOTION.duration == 20.0


def test_rows_from_last_to_first_are_turned_round() -> None:
    back = np.arange(len(LOG))[::-1]
    log = cleaned(LOG.take(back))
    np.testing.assert_array_equal(log["q"], LOG["q"])
    np.testing.assert_array_equal(log.t, LOG.t)
    assert log.repairs == ("The times were in decreasing order, so the order of the rows was reversed.",)


def test_times_with_too_few_digits_are_refused_and_repeated_rows_are_not() -> None:
    with pytest.raises(DataError, match="1799 of 2000 rows have the time of the row before and other values"):
        cleaned(at(LOG, np.round(LOG.t, 1)))
    twice = LOG.take(np.repeat(np.arange(len(LOG)), 2))
    np.testing.assert_array_equal(cleaned(twice)["q"], LOG["q"])


def test_a_velocity_that_nobody_filled_is_left_out() -> None:
    zero = LOG.put(Channel("qd", JOINTS, ("rad/s",) * len(JOINTS), derivative_of="q"), 0.0 * LOG["q"])
    log = cleaned(zero)
    assert "qd" not in log
    assert log.repairs == ("Channel qd never changes although q does: it was dropped.",)
