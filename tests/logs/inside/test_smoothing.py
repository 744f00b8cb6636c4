"""Filter laws: zero phase, exact derivatives, constants stay; the cutoff follows the motion and the noise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from log_examples import make_log
from scipy.signal import butter, sosfiltfilt

from etude.logs import median_rate, smooth
from etude.logs.cleaning.smoothing import (
    auto_cutoff,
    motion_bands,
    quick_length,
    resample,
    segments,
    uniform_grid,
)

T = np.arange(0.0, 20.0 + 1e-9, 0.01)


def test_lines_pass_unchanged() -> None:
    line = np.column_stack([np.full_like(T, 3.0), 2.0 - 0.7 * T])
    out = smooth(T, line, 1.0)
    np.testing.assert_allclose(out.value, line, atol=1e-12)
    np.testing.assert_allclose(out.first, np.broadcast_to([0.0, -0.7], line.shape), atol=1e-12)
    np.testing.assert_allclose(out.second, 0.0, atol=1e-10)


@given(st.floats(0.05, 2.0), st.floats(0.0, 6.3))
def test_derivatives_of_a_sine(frequency: float, phase: float) -> None:
    omega = 2 * np.pi * frequency
    out = smooth(T, np.sin(omega * T + phase)[:, None], 1e3)
    inner = slice(300, -300)
    np.testing.assert_allclose(
        out.first[inner, 0], omega * np.cos(omega * T + phase)[inner], atol=2e-3 * omega
    )
    np.testing.assert_allclose(
        out.second[inner, 0], -(omega**2) * np.sin(omega * T + phase)[inner], atol=2e-3 * omega**2 + 2e-3
    )


def test_zero_phase_and_the_stated_gain() -> None:
    for frequency in (0.5, 1.0, 2.0):
        wave = np.sin(2 * np.pi * frequency * T)[:, None]
        out = smooth(T, wave, 1.0).value[400:-400, 0]
        gain = float(out @ wave[400:-400, 0]) / float(wave[400:-400, 0] @ wave[400:-400, 0])
        assert gain == pytest.approx(1 / (1 + frequency**4), rel=2e-3)
        quarter = np.cos(2 * np.pi * frequency * T)[400:-400]
        assert abs(out @ quarter) < 2e-3 * np.linalg.norm(out) * np.linalg.norm(quarter)


def test_agrees_with_a_forward_and_backward_butterworth() -> None:
    rng = np.random.default_rng(0)
    noise = rng.standard_normal((len(T), 2))
    reference = sosfiltfilt(butter(2, 1.0, fs=100.0, output="sos"), noise, axis=0)
    mine = smooth(T, noise, 1.0).value
    np.testing.assert_allclose(mine[300:-300], reference[300:-300], atol=5e-3 * reference.std())


def test_reversing_time_reverses_the_result() -> None:
    rng = np.random.default_rng(1)
    values = np.cumsum(rng.standard_normal((len(T), 1)), axis=0)
    forward, backward = smooth(T, values, 2.0), smooth(T, values[::-1], 2.0)
    np.testing.assert_allclose(forward.value, backward.value[::-1], atol=1e-9)
    np.testing.assert_allclose(forward.first, -backward.first[::-1], atol=1e-8)


def slow_arm(rate: float, rng: np.random.Generator, encoder_bits: int) -> tuple[np.ndarray, np.ndarray]:
    """A minute at 0.03-0.2 Hz, quantised by an encoder."""
    t = np.arange(0.0, 60.0, 1.0 / rate)
    q = sum(
        a * np.sin(2 * np.pi * f * t + p) for a, f, p in rng.uniform([0.2, 0.03, 0], [0.4, 0.2, 6], (4, 3))
    )
    step = 2 * np.pi / 2**encoder_bits
    return t, (np.round((q + 3e-4 * rng.standard_normal(len(t))) / step) * step)[:, None]


@pytest.mark.parametrize("seed", range(4))
def test_a_slow_arm_with_a_coarse_encoder_gets_about_one_hertz(seed: int) -> None:
    assert 0.4 < auto_cutoff(*slow_arm(100.0, np.random.default_rng(seed), 12)) < 1.8


def test_a_better_encoder_allows_a_wider_filter() -> None:
    cutoffs = [auto_cutoff(*slow_arm(100.0, np.random.default_rng(0), bits)) for bits in (10, 13, 18)]
    assert cutoffs[0] < cutoffs[1] <= cutoffs[2]


def test_a_faster_robot_gets_a_proportionally_wider_filter() -> None:
    slow, fast = make_log(noise=0.0), make_log(noise=0.0)
    ratio = auto_cutoff(fast.t / 3, fast["q"]) / auto_cutoff(slow.t, slow["q"])
    assert ratio == pytest.approx(3.0, rel=1e-6)
    np.testing.assert_allclose(motion_bands(slow.t, slow["q"]), [0.4, 0.6, 0.7], atol=0.11)


def test_the_cutoff_stays_below_an_eighth_of_the_rate() -> None:
    t = np.arange(0.0, 30.0, 0.1)
    assert auto_cutoff(t, np.sin(2 * np.pi * t)[:, None]) == pytest.approx(10.0 / 8)
    assert auto_cutoff(t, np.zeros((len(t), 2))) == pytest.approx(10.0 / 8)


def test_segments_and_grids() -> None:
    t = np.concatenate([np.arange(0, 1, 0.01), np.arange(3, 4, 0.01)])
    assert segments(t) == [slice(0, 100), slice(100, 200)]
    assert segments(t[:1]) == [slice(0, 1)]
    assert median_rate(t) == pytest.approx(100.0)
    grid = uniform_grid(T, 100.0)
    np.testing.assert_allclose(grid, T, atol=1e-12)
    jitter = T + np.random.default_rng(0).uniform(-0.003, 0.003, len(T))
    line = np.column_stack([jitter, -2 * jitter])
    grid = uniform_grid(jitter, 100.0)
    np.testing.assert_allclose(resample(jitter, line, grid), np.column_stack([grid, -2 * grid]), atol=1e-12)


@pytest.mark.parametrize("n", [2, 9_999, 10_000, 60_000, 123_457, 1_000_000])
def test_a_quick_length_loses_few_rows_and_has_small_factors(n: int) -> None:
    found = quick_length(n)
    assert 0.99 * n <= found <= n
    left = found - 1
    for factor in (2, 3, 5, 7, 11):
        while left % factor == 0:
            left //= factor
    assert n < 10_000 or left == 1
