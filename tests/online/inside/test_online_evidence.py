"""The evidence: the weight of least error in hindsight, nothing for a model that is worse or unproven."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from etude_online.command import NEEDED, UpdateWeight

ERRORS = st.lists(st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0)), min_size=1, max_size=40)


def judged(pairs: list[tuple[float, float]], memory: float = 1e9, noise: float = 1e-12) -> float:
    guard = UpdateWeight(memory, noise)
    for frozen, updated in pairs:
        guard.judge(frozen, updated)
    return guard.weight


@given(ERRORS)
def test_in_hindsight_the_mixture_errs_no_more_than_the_frozen_model(
    pairs: list[tuple[float, float]],
) -> None:
    frozen, updated = np.array(pairs).T
    w = judged(pairs)
    assert np.mean((frozen + w * (updated - frozen)) ** 2) <= np.mean(frozen**2) + 1e-9


def test_the_weight_is_the_step_of_the_best_mixture() -> None:
    rng = np.random.default_rng(1)
    frozen, updated = rng.normal(size=400), 0.4 * rng.normal(size=400) + 0.3
    grid = np.linspace(0.0, 1.0, 20001)
    along, apart, own = np.mean(frozen * updated), np.mean(updated**2), np.mean(frozen**2)
    best = grid[np.argmin((1 - grid) ** 2 * own + 2 * grid * (1 - grid) * along + grid**2 * apart)]
    pairs = list(zip(frozen, updated, strict=True))
    assert 0.5 < best < 0.95
    assert judged(pairs) == pytest.approx(best**2 * (3.0 - 2.0 * best), abs=1e-3)


def test_a_worse_model_has_no_weight_and_a_perfect_one_all_of_it() -> None:
    e = np.random.default_rng(0).normal(size=200)
    assert judged([(x, 2.0 * x) for x in e]) == 0.0
    assert judged([(x, x + 3.0) for x in e]) < 0.03
    assert judged([(x, 0.0) for x in e]) == pytest.approx(1.0)
    assert judged([(x, 0.5 * x) for x in e]) == pytest.approx(1.0)  # a half better: all of it, not twice


def test_a_model_that_is_wrong_by_far_does_not_estimate_the_bias() -> None:
    assert 1e6 * judged([(2.0, 2.0 - 1e6)] * 100) < 1e-3


def test_doubt_holds_back_until_the_models_have_differed_by_more_than_noise() -> None:
    assert UpdateWeight(100.0, 1.0).weight == 0.0
    assert UpdateWeight(100.0, 0.0).weight == 0.0
    few, many = judged([(1.0, 0.0)], noise=1.0), judged([(1.0, 0.0)] * 1000, noise=1.0)
    best = 1.0 / (1.0 + NEEDED)
    assert few == pytest.approx(best**2 * (3.0 - 2.0 * best))
    assert many > 0.98


def test_what_is_long_past_does_not_count() -> None:
    good, bad = [(1.0, 0.0)] * 500, [(0.2, 1.0)] * 60
    assert judged(good + bad, memory=20.0) == 0.0
    assert judged(good + bad, memory=1e9) > 0.5
    assert judged(bad + good, memory=20.0) > 0.99


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_errors_that_are_not_finite_take_the_weight_away(bad: float) -> None:
    guard = UpdateWeight(50.0, 1e-6)
    for _ in range(20):
        guard.judge(1.0, 0.0)
    assert guard.weight > 0.9
    guard.judge(bad, 0.0)  # says nothing about the updated model
    assert guard.weight > 0.9
    guard.judge(1.0, bad)
    assert guard.weight == 0.0
    for _ in range(200):
        guard.judge(1.0, 0.0)
    assert guard.weight > 0.9
