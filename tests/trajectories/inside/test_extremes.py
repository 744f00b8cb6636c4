from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etude.errors import UsageError
from etude.trajectories import OVERSAMPLING, FourierTrajectory, riesz_range
from etude.trajectories.extremes import grid
from etude.trajectories.fourier import series
from etude.types import Array


def exact_range(constant: float, cosine: Array, sine: Array) -> tuple[float, float]:
    """Smallest and largest value of constant + sum_k cosine_k cos(k x) + sine_k sin(k x), by companion roots.

    Args:
        constant: mean value.
        cosine, sine: (N,) amplitudes of harmonics 1..N.
    """
    k = np.arange(1.0, len(cosine) + 1.0)
    slope = 0.5 * k * (sine + 1j * cosine)  # derivative = sum_k slope_k e^{ikx} + conjugate
    polynomial = np.concatenate([slope[::-1], [0.0], np.conj(slope)])
    angles = np.angle(np.roots(polynomial)) if np.any(slope != 0.0) else np.zeros(1)
    angles = _polish(np.append(angles, 0.0), k, cosine, sine)
    x = np.outer(angles, k)
    values = constant + np.cos(x) @ cosine + np.sin(x) @ sine
    return float(values.min()), float(values.max())


def _polish(angles: Array, k: Array, cosine: Array, sine: Array) -> Array:
    """The angles, and each moved by one short Newton step towards its stationary point."""
    x = np.outer(angles, k)
    first = np.cos(x) @ (k * sine) - np.sin(x) @ (k * cosine)
    second = -np.cos(x) @ (k * k * cosine) - np.sin(x) @ (k * k * sine)
    step = np.divide(first, second, out=np.zeros_like(first), where=second != 0.0)
    return np.concatenate([angles, angles - np.clip(step, -1e-3, 1e-3)])


def test_closed_forms() -> None:
    low, high = exact_range(0.0, np.zeros(2), np.array([1.0, 0.5]))  # sin x + sin(2x)/2
    assert high == pytest.approx(3.0 * math.sqrt(3.0) / 4.0, abs=1e-14)
    assert low == pytest.approx(-3.0 * math.sqrt(3.0) / 4.0, abs=1e-14)
    low, high = exact_range(0.0, np.array([1.0, 1.0]), np.zeros(2))  # cos x + cos 2x
    assert low == pytest.approx(-9.0 / 8.0, abs=1e-14)
    assert high == pytest.approx(2.0, abs=1e-14)
    assert exact_range(0.7, np.zeros(3), np.zeros(3)) == (0.7, 0.7)


def test_the_bound_holds_the_closed_forms() -> None:
    for cosine, sine, high in (
        ([0.0, 0.0], [1.0, 0.5], 3.0 * math.sqrt(3.0) / 4.0),
        ([1.0, 1.0], [0.0, 0.0], 2.0),
    ):
        for oversampling in (3, 8, 16, 64):
            x, kappa = grid(2, oversampling)
            k = np.arange(1, 3)
            values = np.cos(np.outer(x, k)) @ cosine + np.sin(np.outer(x, k)) @ sine
            lower, upper = riesz_range(values[:, None], kappa)
            true_low, true_high = exact_range(0.0, np.array(cosine), np.array(sine))
            assert lower[0] <= true_low <= true_high <= upper[0]
            assert upper[0] - lower[0] <= (true_high - true_low) / kappa * (1.0 + 1e-12)
            assert true_high == pytest.approx(high, abs=1e-12)


@given(st.integers(1, 10), st.integers(3, 20), st.integers(0, 10**6))
@settings(max_examples=60, deadline=None)
def test_the_bound_is_never_too_small_nor_larger_than_the_theorem_says(
    degree: int, oversampling: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    cosine, sine = rng.standard_normal((2, degree)) * 10.0 ** rng.uniform(-3, 3, (2, degree))
    x, kappa = grid(degree, oversampling)
    k = np.arange(1, degree + 1)
    values = np.cos(np.outer(x, k)) @ cosine + np.sin(np.outer(x, k)) @ sine
    (low,), (high,) = riesz_range(values[:, None], kappa, float(np.abs(cosine).sum() + np.abs(sine).sum()))
    true_low, true_high = exact_range(0.0, cosine, sine)
    assert low <= true_low
    assert true_high <= high
    assert high - low <= (true_high - true_low) / kappa * (1.0 + 1e-9)


def exact_ranges(table: np.ndarray, omega0: float, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Extremes of a derivative of each column, from its roots."""
    harmonics = len(table) // 2
    w = omega0 * np.arange(1, harmonics + 1)[:, None]
    a, b = table[1 : harmonics + 1], table[harmonics + 1 :]
    cosine, sine = ((-b / w, a / w), (a, b), (b * w, -a * w))[order]
    constant = table[0] if order == 0 else np.zeros_like(table[0])
    pairs = [exact_range(float(c), x, y) for c, x, y in zip(constant, cosine.T, sine.T, strict=True)]
    return np.transpose(pairs)[0], np.transpose(pairs)[1]


def proved_ranges(table: np.ndarray, omega0: float, order: int) -> tuple[np.ndarray, np.ndarray]:
    values, amplitudes, kappa = FourierTrajectory(table, omega0, 1.0).bound(order)
    return riesz_range(values, kappa, amplitudes)


def violations(count: int, harmonics: int, rng: np.random.Generator) -> tuple[int, float]:
    """Columns outside their proved ranges at 100 times more samples, and the worst ratio to true extremes."""
    shape = 2 * harmonics + 1, count
    table = rng.standard_normal(shape) * 10.0 ** rng.uniform(-1, 1, shape)
    omega0 = float(10.0 ** rng.uniform(-1, 1))
    bad, worst = np.zeros(count, dtype=bool), 0.0
    angles = 2.0 * np.pi * np.arange(100 * OVERSAMPLING * harmonics) / (100 * OVERSAMPLING * harmonics)
    parts = np.array_split(angles, max(1, len(angles) * count // 2_000_000))
    for order in range(3):
        low, high = proved_ranges(table, omega0, order)
        true_low, true_high = exact_ranges(table, omega0, order)
        bad |= (true_low < low) | (true_high > high)
        worst = max(worst, float(np.max((high - low) / (true_high - true_low))))
        for part in parts:
            values = series(part, harmonics, omega0)[order] @ table
            bad |= (values.min(axis=0) < low) | (values.max(axis=0) > high)
    return int(bad.sum()), worst


def check_violations(count: int) -> None:
    rng = np.random.default_rng(count)
    for harmonics in range(1, 11):
        bad, worst = violations(count // 10, harmonics, rng)
        assert bad == 0
        assert 1.0 <= worst <= 1.0 / math.cos(math.pi / OVERSAMPLING) * (1.0 + 1e-9)


def test_no_violation_in_several_hundred_trajectories() -> None:
    check_violations(400)


@pytest.mark.slow
def test_no_violation_in_ten_thousand_trajectories() -> None:
    check_violations(10_000)


def test_a_coarse_grid_alone_would_miss_extremes() -> None:
    """Why the bound is needed: the samples themselves stay below the true extreme."""
    x, kappa = grid(5, 3)
    values = np.cos(5.0 * (x - math.pi / 15.0))[:, None]
    assert values.max() < 0.51
    assert riesz_range(values, kappa)[1][0] >= 1.0 - 1e-12


@pytest.mark.parametrize(("degree", "oversampling"), [(0, 8), (3, 2)])
def test_bad_grids(degree: int, oversampling: int) -> None:
    with pytest.raises(UsageError, match="degree >= 1 and oversampling >= 3"):
        grid(degree, oversampling)


def test_samples_that_hold_the_extremes_are_taken_as_they_are() -> None:
    values = np.array([[0.1], [0.7], [-0.3]])
    assert [float(end[0]) for end in riesz_range(values, 1.0)] == [-0.3, 0.7]


def test_large_terms_that_cancel_cost_an_allowance_for_their_rounding() -> None:
    values = np.array([[0.1], [0.7], [-0.3]])
    for kappa in (0.9, 1.0):
        low, high = (end[0] for end in riesz_range(values, kappa))
        wider = riesz_range(values, kappa, 1e12)
        assert wider[0][0] < low - 1e-3
        assert wider[1][0] > high + 1e-3
