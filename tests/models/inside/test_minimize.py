"""Conjugate gradients: the minimum, the meaning of the length, and survival of infinities."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from etude.errors import NumericalError, UsageError
from etude.models import minimize
from etude.models.gp.minimize import _between, _Probe


def rosenbrock(x: np.ndarray) -> tuple[float, np.ndarray]:
    a, b = x
    return (1 - a) ** 2 + 100 * (b - a * a) ** 2, np.array(
        [-2 * (1 - a) - 400 * a * (b - a * a), 200 * (b - a * a)]
    )


def quadratic(x: np.ndarray) -> tuple[float, np.ndarray]:
    scale = np.array([1.0, 3.0, 10.0])
    return 0.5 * float(scale @ (x * x)), scale * x


def test_rosenbrock_is_solved_in_a_few_searches() -> None:
    found = minimize(rosenbrock, np.array([-1.2, 1.0]), 60)
    np.testing.assert_allclose(found.x, [1.0, 1.0], atol=1e-5)
    assert found.evaluations < 200


def test_a_quadratic_of_three_dimensions_needs_a_few_searches() -> None:
    assert minimize(quadratic, np.array([1.0, -2.0, 3.0]), 8).value < 1e-6


def test_values_never_rise() -> None:
    history = minimize(rosenbrock, np.array([-1.2, 1.0]), 40).history
    assert all(later <= earlier for earlier, later in pairwise(history))


def counted(length: int) -> tuple[int, int]:
    calls = 0

    def objective(x: np.ndarray) -> tuple[float, np.ndarray]:
        nonlocal calls
        calls += 1
        return rosenbrock(x)

    found = minimize(objective, np.array([-1.2, 1.0]), length)
    assert found.evaluations == calls
    return calls, len(found.history) - 1


@pytest.mark.parametrize("length", [1, 3, 7])
def test_positive_length_counts_line_searches(length: int) -> None:
    calls, searches = counted(length)
    assert searches == length
    assert calls > length


@pytest.mark.parametrize("length", [2, 5, 17])
def test_negative_length_counts_evaluations(length: int) -> None:
    assert counted(-length)[0] <= length


def test_infinite_values_make_the_search_step_back() -> None:
    def walled(x: np.ndarray) -> tuple[float, np.ndarray]:
        if x[0] <= 0.0:
            return np.inf, np.full(1, np.nan)
        return float(x[0] - np.log(x[0])), 1.0 - 1.0 / x

    found = minimize(walled, np.array([0.01]), 30)
    assert found.x[0] == pytest.approx(1.0, abs=1e-4)


def test_refusals() -> None:
    with pytest.raises(UsageError, match="length 0"):
        minimize(quadratic, np.zeros(3), 0)
    with pytest.raises(NumericalError, match="not finite at the start"):
        minimize(lambda x: (np.nan, x), np.zeros(3), 5)


def test_a_start_at_the_minimum_stays() -> None:
    found = minimize(quadratic, np.zeros(3), 10)
    assert found.value == 0.0
    np.testing.assert_array_equal(found.x, 0.0)


@pytest.mark.parametrize("budget", [2, 3, 4])
def test_a_search_cut_short_returns_the_best_point_it_saw(budget: int) -> None:
    seen = []

    def objective(x: np.ndarray) -> tuple[float, np.ndarray]:
        value, gradient = rosenbrock(x)
        seen.append(value)
        return value, gradient

    assert minimize(objective, np.array([-1.2, 1.0]), -budget).value == min(seen)


@pytest.mark.parametrize("quadratic", [True, False])
def test_interpolated_steps_stay_inside_their_bracket(quadratic: bool) -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        (a, b), values, slopes = np.sort(rng.normal(size=2)), rng.normal(size=2), rng.normal(size=2) * 10
        low = _Probe(a, values[0], slopes[0], np.zeros(1), np.zeros(1))
        high = _Probe(b, values[1], slopes[1], np.zeros(1), np.zeros(1))
        for first, second in ((low, high), (high, low)):
            with np.errstate(all="ignore"):
                step = _between(first, second, quadratic=quadratic)
            assert a + 0.0999 * (b - a) <= step <= b - 0.0999 * (b - a)
