"""Tests and intervals over seeds: other libraries' values, closed forms, and error rates by simulation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from made_up_values import drawn
from scipy import stats

from etude.errors import UsageError
from etude_studies.thesis import statistics
from etude_studies.thesis.settling import (
    MOST,
    difference_power,
    equivalence_power,
    seeds_for_difference,
    seeds_for_equivalence,
)

SKEWED = np.random.default_rng(3).exponential(size=15) - 0.6


def rate(hits: int, trials: int, wanted: float) -> None:
    """The share of hits is `wanted` within 3.5 of its own standard deviations."""
    assert abs(hits / trials - wanted) < 3.5 * math.sqrt(wanted * (1.0 - wanted) / trials)


def test_t_and_its_interval_are_those_of_scipy() -> None:
    x = drawn(12, 0.3, 0.7)
    other = stats.ttest_1samp(x, 0.0)
    assert statistics.paired_t(x) == pytest.approx(other.pvalue, rel=1e-10)
    for level in (0.90, 0.95):
        assert statistics.interval(x, level) == pytest.approx(tuple(other.confidence_interval(level)))
    assert statistics.paired_t(x) == statistics.paired_t(-x)


@pytest.mark.parametrize("two_sided", [True, False])
@pytest.mark.parametrize("mean", [0.4, -0.1])
def test_sign_flips_are_those_of_all_signs(mean: float, two_sided: bool) -> None:
    x = drawn(10, mean, 0.7)
    alternative = "two-sided" if two_sided else "greater"
    every = stats.permutation_test(
        (x,), np.mean, permutation_type="samples", n_resamples=np.inf, alternative=alternative
    ).pvalue
    found = statistics.sign_flip(x, two_sided=two_sided)
    assert found == pytest.approx(every, abs=4.0 * math.sqrt(every * (1 - every) / statistics.FLIPS) + 1e-4)
    assert found == statistics.sign_flip(x, two_sided=two_sided), "the same draws each time"


def test_sign_flips_cannot_pass_with_four_seeds_or_be_0() -> None:
    assert statistics.sign_flip([1.0, 1.1, 0.9, 1.0]) == pytest.approx(2 / 16, abs=0.01)
    # no draw of 20,000 meets one of 2^-39
    assert statistics.sign_flip(np.full(40, 0.1)) == pytest.approx(1 / (statistics.FLIPS + 1))
    assert statistics.sign_flip([0.0, 0.0, 0.0]) == 1.0


def test_bca_is_that_of_scipy_on_the_same_draws() -> None:
    rng = np.random.default_rng(statistics.GENERATOR)
    other = stats.bootstrap(
        (SKEWED,), np.mean, n_resamples=statistics.RESAMPLES, method="BCa", rng=rng, confidence_level=0.9
    ).confidence_interval
    assert statistics.bca(SKEWED, 0.9) == pytest.approx((other.low, other.high), rel=1e-9)


def test_bca_of_skewed_seeds_leans_to_the_long_side() -> None:
    low, high = statistics.bca(SKEWED)
    mean = SKEWED.mean()
    assert high - mean > 1.1 * (mean - low)
    assert statistics.bca([0.5, 0.5, 0.5]) == (0.5, 0.5)


@pytest.mark.parametrize(("wins", "n"), [(0, 20), (9, 20), (20, 20), (1, 3)])
def test_wilson_is_that_of_scipy(wins: int, n: int) -> None:
    for level in (0.9, 0.95):
        other = stats.binomtest(wins, n).proportion_ci(level, method="wilson")
        assert statistics.wilson(wins, n, level) == pytest.approx((other.low, other.high), abs=1e-12)


def test_wilson_refuses_what_is_no_share() -> None:
    for wins, n in ((0, 0), (3, 2), (-1, 2)):
        with pytest.raises(UsageError, match="no share"):
            statistics.wilson(wins, n)


def test_holm_by_hand() -> None:
    # 0.01 * 4, 0.02 * 3, 0.03 * 2 raised to 0.06, 0.9
    assert statistics.holm([0.02, 0.9, 0.01, 0.03]) == pytest.approx([0.06, 0.9, 0.04, 0.06])
    assert statistics.holm([0.5, 0.6]) == pytest.approx([1.0, 1.0])
    assert statistics.holm([]).shape == (0,)


def test_benjamini_hochberg_is_that_of_scipy() -> None:
    p = np.random.default_rng(1).random(30) ** 2
    assert statistics.benjamini_hochberg(p) == pytest.approx(stats.false_discovery_control(p))


def test_a_level_at_its_place_is_what_the_definition_compares_with() -> None:
    p = [0.02, 0.9, 0.01, 0.03]
    # of four, one is found: the others meet a third next, and that one has met a quarter
    assert list(statistics.holm(p) < 0.06) == [False, False, True, False]
    assert statistics.holm_levels(p, 0.06) == pytest.approx([0.02, 0.02, 0.015, 0.02])
    assert list(statistics.benjamini_hochberg(p) < 0.041) == [True, False, True, True]
    assert statistics.benjamini_hochberg_levels(p, 0.041) == pytest.approx(0.041 * np.array([3, 4, 3, 3]) / 4)


def test_p_outside_0_to_1_is_refused() -> None:
    for p in ([0.1, 1.2], [-0.1], [math.nan]):
        with pytest.raises(UsageError, match="p value"):
            statistics.holm(p)


@pytest.mark.parametrize("mean", [0.0, 0.1, -0.1, 0.3])
def test_equivalence_is_two_one_sided_tests(mean: float) -> None:
    x, margin = drawn(20, mean, 0.15), math.log(1.15)
    above = stats.ttest_1samp(x, -margin, alternative="greater").pvalue
    below = stats.ttest_1samp(x, margin, alternative="less").pvalue
    assert statistics.equivalence(x, margin) == pytest.approx(max(above, below))
    low, high = statistics.interval(x, 0.9)
    assert (statistics.equivalence(x, margin) < 0.05) == (-margin < low and high < margin)
    assert (statistics.equivalence_flip(x, margin) < 0.05) == (statistics.equivalence(x, margin) < 0.05)


@pytest.mark.parametrize("mean", [0.0, 0.15, 0.2, 0.22, -0.22, 0.3])
def test_outside_is_an_interval_wholly_beyond(mean: float) -> None:
    x, margin = drawn(20, mean, 0.15), math.log(1.15)
    low, high = statistics.interval(x)
    assert (statistics.outside(x, margin) < 0.05) == (low > margin or high < -margin)
    assert (statistics.outside_flip(x, margin) < 0.05) == (low > margin or high < -margin)
    assert statistics.outside(x, margin) == pytest.approx(statistics.outside(-x, margin))


def test_prediction_interval_by_hand() -> None:
    # 1, 2, 3: mean 2, sd 1, t(2, 0.975) = 4.302653, sqrt(4/3)
    half = 4.302653 * math.sqrt(4.0 / 3.0)
    assert statistics.prediction_interval([1.0, 2.0, 3.0]) == pytest.approx((2 - half, 2 + half), rel=1e-6)


def test_without_spread_t_says_0_or_1_and_the_flips_decide() -> None:
    same = [0.1] * 6
    assert statistics.moments(same)[2] == 0.0
    assert statistics.paired_t(same) == 0.0
    assert statistics.sign_flip(same) == pytest.approx(2 / 64, abs=0.005)
    assert statistics.paired_t([0.0, 0.0]) == 1.0
    assert statistics.interval(same) == pytest.approx((0.1, 0.1))
    assert statistics.equivalence(same, 0.2) == 0.0
    assert statistics.equivalence(same, 0.05) == 1.0
    assert statistics.outside(same, 0.05) == 0.0
    assert statistics.outside(same, 0.2) == 1.0


@pytest.mark.parametrize("x", [[], [1.0], [1.0, math.nan], [1.0, math.inf], [[1.0, 2.0]]])
def test_too_few_or_not_finite_is_refused(x: list[float]) -> None:
    for statistic in (statistics.paired_t, statistics.interval, statistics.sign_flip, statistics.bca):
        with pytest.raises(UsageError, match="two finite numbers"):
            statistic(x)


def test_the_interval_covers_as_often_as_it_says() -> None:
    rng, inside, single, trials = np.random.default_rng(5), 0, 0, 2000
    for _ in range(trials):
        x, one_more = rng.normal(0.3, 2.0, 8), rng.normal(0.3, 2.0)
        low, high = statistics.interval(x)
        inside += low <= 0.3 <= high
        low, high = statistics.prediction_interval(x)
        single += low <= one_more <= high
    rate(inside, trials, 0.95)
    rate(single, trials, 0.95)


def test_two_one_sided_tests_err_at_the_edge_of_the_margin_as_often_as_they_say() -> None:
    rng, found, trials, margin = np.random.default_rng(6), 0, 2000, math.log(1.15)
    for _ in range(trials):
        found += statistics.equivalence(rng.normal(margin, 0.1, 12), margin) < 0.05
    rate(found, trials, 0.05)


@pytest.mark.parametrize("real", [0, 3])
def test_holm_keeps_the_family_error_where_plain_p_does_not(real: int) -> None:
    """`real` of twelve have an effect; an error is any rejection among the others."""
    rng, errors, plain, trials = np.random.default_rng(7), 0, 0, 600
    for _ in range(trials):
        p = [statistics.paired_t(rng.normal(2.0 if i < real else 0.0, 1.0, 10)) for i in range(12)]
        errors += bool((statistics.holm(p)[real:] < 0.05).any())
        plain += bool((np.array(p[real:]) < 0.05).any())
    rate(errors, trials, 0.05)
    assert plain > 0.3 * trials


def test_benjamini_hochberg_keeps_the_share_of_false_findings() -> None:
    rng, shares = np.random.default_rng(8), []
    for _ in range(300):
        p = [statistics.paired_t(rng.normal(1.5 if i < 6 else 0.0, 1.0, 10)) for i in range(12)]
        found = statistics.benjamini_hochberg(p) < 0.1
        shares.append(found[6:].sum() / max(found.sum(), 1))
    # 0.1 times the share of true nulls, in independent tests exactly
    assert np.mean(shares) == pytest.approx(0.05, abs=0.02)


def test_sign_flips_err_as_often_as_they_say(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(statistics, "FLIPS", 999)
    rng, found, trials = np.random.default_rng(9), 0, 1000
    for _ in range(trials):
        # heavy tails, symmetric: what a t test is not made for
        found += statistics.sign_flip(rng.standard_t(2, 12)) < 0.05
    rate(found, trials, 0.05)


@pytest.mark.parametrize(("effect", "seeds"), [(0.2, 199), (0.5, 34), (0.8, 15)])
def test_seeds_for_a_difference_are_the_printed_ones(effect: float, seeds: int) -> None:
    """Cohen's small, medium and large effect in a paired t test, 80 % at 5 % two-sided, as G*Power prints."""
    assert seeds_for_difference(effect, 1.0, 0.05) == seeds
    assert seeds_for_difference(-3.0 * effect, 3.0, 0.05) == seeds


def test_seeds_for_a_difference_give_the_power_they_promise() -> None:
    n = seeds_for_difference(0.3, 0.35, 0.01)
    assert n is not None
    assert difference_power(n, 0.3, 0.35, 0.01) >= 0.8 > difference_power(n - 1, 0.3, 0.35, 0.01)
    rng, trials = np.random.default_rng(10), 2000
    found = sum(statistics.paired_t(rng.normal(0.3, 0.35, n)) < 0.01 for _ in range(trials))
    rate(found, trials, difference_power(n, 0.3, 0.35, 0.01))


@pytest.mark.parametrize("mean", [0.0, 0.05])
def test_seeds_for_equivalence_give_the_power_they_promise(mean: float) -> None:
    margin = math.log(1.15)
    n = seeds_for_equivalence(mean, 0.2, margin)
    assert n is not None
    assert equivalence_power(n, mean, 0.2, margin, 0.05) >= 0.8
    assert equivalence_power(n - 1, mean, 0.2, margin, 0.05) < 0.8
    rng, trials = np.random.default_rng(11), 2000
    found = sum(statistics.equivalence(rng.normal(mean, 0.2, n), margin) < 0.05 for _ in range(trials))
    rate(found, trials, equivalence_power(n, mean, 0.2, margin, 0.05))


def test_what_no_number_of_seeds_settles() -> None:
    assert seeds_for_difference(0.0, 1.0, 0.05) is None
    assert seeds_for_difference(1e-4, 1.0, 0.05) is None
    assert seeds_for_equivalence(0.2, 0.1, 0.2) is None
    assert seeds_for_equivalence(-0.3, 0.1, 0.2) is None
    assert MOST < (2.8 / 1e-4) ** 2


def test_sign_flips_need_enough_signs_whatever_the_spread() -> None:
    # 2^-5 = 0.031 is the first above 0.025: six seeds two-sided, five one-sided
    assert seeds_for_difference(50.0, 1e-3, 0.05) == 6
    assert seeds_for_difference(1.0, 0.0, 0.05) == 6
    assert seeds_for_equivalence(0.0, 0.0, 0.1) == 5
    assert statistics.sign_flip([1.0] * 6) < 0.05 < statistics.sign_flip([1.0] * 5)
