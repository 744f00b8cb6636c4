"""What is measured of a test run: values that are known in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from etude.types import Channel, Log
from etude_studies.thesis.arm_measures import (
    density_loss,
    description,
    excursions,
    honesty,
    jerkiness,
    near_share,
    nearest_distance,
    rank_correlation,
    reversals,
    standing,
    stuck,
    tracking,
    until_it_moves,
)

RATE, PERIOD = 100.0, 20.0
OMEGA = 2.0 * math.pi / PERIOD
T = np.arange(6001) / RATE
SWING = 0.4
LAG = 0.3


def sine(size: float = SWING, lag: float = 0.0) -> np.ndarray:
    """(T, 1) rad, three periods from a zero on."""
    return size * np.sin(OMEGA * (T - lag))[:, None]


def speed() -> np.ndarray:
    return SWING * OMEGA * np.cos(OMEGA * T)[:, None]


def run_of(actual: np.ndarray, feedback: float = 0.0) -> Log:
    """A run of the sine, its command 10 sin and a constant part of feedback."""
    names = {"q_des": sine(), "q_true": actual, "qd_des": speed()}
    command = 10.0 * np.sin(OMEGA * T)[:, None]
    names |= {"command": command, "command_fb": np.full_like(command, feedback)}
    names |= {"command_ff": command - feedback}
    rest = {name: np.concatenate([np.full((200, 1), 9.0), rows]) for name, rows in names.items()}
    t = np.concatenate([np.arange(-200, 0) / RATE, T])
    return Log(t, {name: Channel(name, ("a",), ("rad",), "other") for name in rest}, rest)


def figures(log: Log) -> dict[str, float]:
    return {name: float(values[0]) for name, values in (*tracking(log, RATE), *description(log, RATE))}


def turns() -> list[np.ndarray]:
    return [reversals(speed()[:, 0])]


def test_a_lag_is_an_error_of_the_closed_form_and_leaves_the_extremes() -> None:
    """s sin wt - s sin w(t - d) = 2 s sin(wd/2) cos(w(t - d/2)): mean 2/pi, deviation 1/sqrt 2 of it."""
    found = figures(run_of(sine(lag=LAG)))
    size = math.degrees(2.0 * SWING * math.sin(OMEGA * LAG / 2.0))
    assert found["error"] == pytest.approx(size * 2.0 / math.pi, rel=1e-3)
    assert found["error_rms"] == pytest.approx(size / math.sqrt(2.0), rel=1e-3)
    assert found["undershoot"] == pytest.approx(0.0, abs=1e-3)
    assert found["jerk"] == pytest.approx(2.0 * math.sin(OMEGA * LAG / 2.0), rel=1e-3)


@pytest.mark.parametrize("part", [0.9, 1.2])
def test_a_smaller_swing_falls_short_and_a_larger_overshoots(part: float) -> None:
    found = figures(run_of(sine(part * SWING)))
    short = math.degrees((1.0 - part) * SWING)
    for name in ("undershoot", "undershoot_max", "undershoot_min"):
        assert found[name] == pytest.approx(short, rel=1e-6)
    assert found["error"] == pytest.approx(abs(short) * 2.0 / math.pi, rel=1e-3)
    assert found["spike"] == pytest.approx(math.sqrt(2.0), rel=1e-3)
    assert found["jerk"] == pytest.approx(abs(1.0 - part), rel=1e-6)


def test_maxima_and_minima_are_told_apart() -> None:
    found = figures(run_of(sine() * np.where(sine() > 0.0, 0.8, 1.1)))
    assert found["undershoot_max"] == pytest.approx(math.degrees(0.2 * SWING), rel=1e-6)
    assert found["undershoot_min"] == pytest.approx(math.degrees(-0.1 * SWING), rel=1e-6)
    assert found["undershoot"] == pytest.approx(math.degrees(0.05 * SWING), rel=1e-6)


def test_what_feedback_adds() -> None:
    """The rest before t = 0, of other values, must not count."""
    found = figures(run_of(sine(0.5 * SWING), feedback=2.0))
    size = 10.0 / math.sqrt(2.0)
    for name in ("feedback_share", "feedback_median", "feedback_p95"):
        assert found[name] == pytest.approx(2.0 / size, rel=1e-3)
    assert found["nmse"] == pytest.approx(4.0 / size**2, rel=1e-3)
    assert found["effort"] == pytest.approx(5.0 * SWING * OMEGA / math.pi, rel=1e-2)


def test_reversals_are_where_the_speed_changes_its_sign() -> None:
    found = reversals(speed()[:, 0])
    np.testing.assert_allclose(T[found], [5.0, 15.0, 25.0, 35.0, 45.0, 55.0], atol=1.01 / RATE)
    assert not len(reversals(np.abs(speed()[:, 0]) + 1.0))


def test_a_rest_between_two_signs_is_one_reversal() -> None:
    np.testing.assert_array_equal(reversals(np.array([1.0, 1.0, 0.0, 0.0, -1.0, -1.0])), [4])


@pytest.mark.parametrize("speeds", [[0.0, 0.0, 1.0, 1.0, 0.0], [1.0, 0.0, 0.0, 1.0]])
def test_a_start_from_rest_is_no_reversal(speeds: list[float]) -> None:
    assert not len(reversals(np.array(speeds)))


def test_share_near_reversals() -> None:
    at = reversals(speed()[:, 0])
    assert near_share(np.ones(6000), at) == pytest.approx(0.2, abs=1e-3)
    near = np.abs(np.arange(6000)[:, None] - at).min(axis=1) < 50
    assert near_share(near.astype(float), at) == 1.0
    assert near_share(1.0 - near, at) < 0.2
    assert math.isnan(near_share(np.ones(10), np.zeros(0, dtype=np.int64)))


def held(seconds: float) -> np.ndarray:
    """The sine, held at each reversal for so long, then at the desired place again within 0.3 s."""
    actual, back = sine(), 30
    for turn in turns()[0]:
        end = turn + round(seconds * RATE)
        actual[turn:end] = actual[turn]
        ramp = np.linspace(0.0, 1.0, back)[:, None]
        actual[end : end + back] = (1.0 - ramp) * actual[turn] + ramp * sine()[end : end + back]
    return actual


def test_the_window_after_a_reversal_ends_when_the_joint_moves_again() -> None:
    """The error of a joint that stands for two seconds passes zero at the reversal and grows after it."""
    actual = held(2.0)
    windows = until_it_moves(np.gradient(actual[:, 0], 1.0 / RATE), speed()[:, 0], RATE)
    assert [own.start for own in windows] == list(turns()[0])
    assert [(own.stop - own.start) / RATE for own in windows] == pytest.approx([2.0] * 6, abs=0.02)
    found = {name: float(values[0]) for name, values in standing(run_of(actual), RATE)}
    assert found["after_reversal"] > 0.8
    assert found["after_reversal_time"] == pytest.approx(12.0 / 60.0, abs=0.01)
    assert found["stuck_after"] == 1.0
    around = near_share(np.abs(sine() - actual)[:, 0], turns()[0])
    assert around < 0.5, "the window around reversals misses most of it"


def test_a_joint_that_follows_at_once_has_no_window() -> None:
    found = {name: float(values[0]) for name, values in standing(run_of(sine(lag=LAG)), RATE)}
    assert found["stuck_after"] == 0.0
    assert found["after_reversal_time"] < 6.0 * (LAG + 0.6) / 60.0
    never = {name: float(values[0]) for name, values in standing(run_of(np.full_like(sine(), 0.1)), RATE)}
    assert never["after_reversal_time"] == pytest.approx(55.0 / 60.0, abs=0.01), "up to the next reversal"


def test_a_joint_that_rests_at_its_reversals_is_stuck() -> None:
    wanted, at = sine(), turns()
    held = wanted.copy()
    for turn in at[0][:3]:
        held[turn : turn + 90] = held[turn]
    assert stuck(wanted, speed(), at, RATE)[0] == 0.0
    assert stuck(held, speed(), at, RATE)[0] == 0.5
    assert stuck(np.zeros_like(wanted), np.zeros_like(wanted), at, RATE)[0] == 0.0
    shortly = wanted.copy()
    for turn in at[0]:
        shortly[turn + 60 : turn + 80] = shortly[turn + 60]
    assert stuck(shortly, speed(), at, RATE)[0] == 0.0


def test_jerkiness_of_a_rough_motion_is_larger() -> None:
    rough = sine() + 1e-4 * np.random.default_rng(0).standard_normal((6001, 1))
    assert jerkiness(sine(), rough, RATE)[0] > 10.0 * jerkiness(sine(), sine(lag=LAG), RATE)[0]


def test_excursions_use_the_largest_error_within_a_second() -> None:
    at = turns()
    actual = sine() + 0.01
    actual[at[0][0] + 99] += 0.03
    actual[at[0][2] + 101] += 0.5
    found = dict(excursions(sine(), actual, at, RATE))
    assert found["spike"][0] == pytest.approx((4.0 + 1.0 + 1.0) / 3.0, rel=1e-6)


def test_normal_errors_are_covered_as_they_should_be() -> None:
    rng = np.random.default_rng(1)
    noisy = rng.uniform(0.5, 4.0, (40_000, 2))
    mean = rng.standard_normal(noisy.shape)
    command = mean + np.sqrt(noisy) * rng.standard_normal(noisy.shape)
    found = dict(honesty(command, mean, 0.5 * noisy, noisy))
    np.testing.assert_allclose(found["z2"], 1.0, atol=0.04)
    np.testing.assert_allclose(found["coverage68"], 0.6827, atol=0.01)
    np.testing.assert_allclose(found["coverage95"], 0.95, atol=0.006)
    np.testing.assert_allclose(found["variance_noisy"], 2.0 * found["variance"])
    entropy = 0.5 * np.log(2.0 * np.pi * math.e * noisy).mean(axis=0)
    np.testing.assert_allclose(found["nlpd"], entropy, atol=0.02)
    assert np.all((found["spearman"] > 0.1) & (found["spearman"] < 0.6))


def test_an_error_of_known_size_has_the_density_of_the_formula() -> None:
    """-log N(e | 0, v) = log(2 pi v) / 2 + e^2 / 2v."""
    error, variance = np.full((3, 1), 2.0), np.full((3, 1), 4.0)
    assert density_loss(error, variance)[0] == pytest.approx(0.5 * math.log(8.0 * math.pi) + 0.5)


def test_errors_that_rise_with_the_deviation_correlate_fully() -> None:
    noisy = np.linspace(1.0, 9.0, 50)[:, None]
    found = dict(honesty(np.sqrt(noisy), np.zeros_like(noisy), noisy, noisy))
    assert found["spearman"][0] == pytest.approx(1.0)
    assert rank_correlation(np.arange(5.0), -np.arange(5.0)) == pytest.approx(-1.0)
    assert math.isnan(rank_correlation(np.ones(5), np.arange(5.0)))


def test_nearest_distance_is_in_units_of_the_scale() -> None:
    known = np.zeros((10, 2))
    new = np.tile([3.0, 8.0], (10, 1))
    assert nearest_distance(new, known, np.array([1.0, 2.0])) == pytest.approx(5.0)
    assert nearest_distance(known, known, np.ones(2)) == 0.0
