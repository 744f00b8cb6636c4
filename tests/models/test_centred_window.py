"""The centred window: derivatives of polynomials are exact, the delay half a window, bad input stays out."""

from __future__ import annotations

import numpy as np
import pytest

from etude.errors import UsageError
from etude.models.online.window import ORDER, CentredWindow, polynomial_weights

RATE = 100.0


def filled(window: CentredWindow, t: np.ndarray, q: np.ndarray, tau: np.ndarray) -> CentredWindow:
    for time, position, command in zip(t, q, tau, strict=True):
        window.push(time, position, command)
    return window


def motion(t: np.ndarray) -> tuple[np.ndarray, ...]:
    """A cubic and a parabola: value, first and second derivative."""
    q = np.column_stack([1.0 + 2.0 * t - t**2 + 0.3 * t**3, 4.0 - t + 0.5 * t**2])
    qd = np.column_stack([2.0 - 2.0 * t + 0.9 * t**2, -1.0 + t])
    qdd = np.column_stack([-2.0 + 1.8 * t, np.ones_like(t)])
    return q, qd, qdd


def test_polynomials_up_to_the_order_are_differentiated_exactly() -> None:
    t = 3.0 + np.arange(170) / RATE
    q, qd, qdd = motion(t)
    sample = filled(CentredWindow(2, RATE, 1.0), t, q, 5.0 * q).middle()
    assert sample is not None
    place = 170 - 51
    assert sample.t == pytest.approx(t[place])
    for found, wanted in ((sample.q, q), (sample.qd, qd), (sample.qdd, qdd), (sample.tau, 5.0 * q)):
        np.testing.assert_allclose(found, wanted[place], rtol=1e-9, atol=1e-9)


def test_weights_are_those_of_a_least_squares_polynomial() -> None:
    y = np.random.default_rng(0).normal(size=31)
    t = 0.02 * np.arange(-15, 16)
    fitted = np.polynomial.Polynomial.fit(t, y, ORDER)
    wanted = [fitted(0.0), fitted.deriv(1)(0.0), fitted.deriv(2)(0.0)]
    np.testing.assert_allclose(polynomial_weights(31, 0.02) @ y, wanted, rtol=1e-8)


def test_position_and_command_are_smoothed_alike() -> None:
    noise = np.random.default_rng(1).normal(size=(101, 1))
    sample = filled(CentredWindow(1, RATE, 1.0), np.arange(101) / RATE, noise, noise).middle()
    assert sample is not None
    np.testing.assert_array_equal(sample.q, sample.tau)
    assert abs(sample.q[0]) < 0.6  # averages: one deviation would be 1


def test_nothing_comes_before_the_window_is_full() -> None:
    t = np.arange(100) / RATE
    window = filled(CentredWindow(2, RATE, 1.0), t, *(motion(t)[:2]))
    assert window.middle() is None
    window.push(1.0, np.zeros(2), np.zeros(2))
    assert window.middle() is not None


def test_a_stuck_clock_is_ignored_and_counted_and_spoils_nothing() -> None:
    t = np.arange(150) / RATE
    q, qd, _ = motion(t)
    clean, stuck = (filled(CentredWindow(2, RATE, 1.0), t, q, qd) for _ in range(2))
    for time in (t[-1], t[-1] - 0.5):
        stuck.push(time, np.full(2, 99.0), np.zeros(2))
    assert (clean.ignored, stuck.ignored) == (0, 2)
    np.testing.assert_array_equal(clean.middle().q, stuck.middle().q)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_measurement_that_is_not_finite_starts_the_window_anew(bad: float) -> None:
    t = np.arange(150) / RATE
    q, qd, _ = motion(t)
    window = filled(CentredWindow(2, RATE, 1.0), t, q, qd)
    window.push(1.5, np.array([0.0, bad]), np.zeros(2))
    assert window.ignored == 1
    assert window.middle() is None
    later = 1.51 + np.arange(101) / RATE
    sample = filled(window, later, motion(later)[0], motion(later)[1]).middle()
    assert sample is not None
    np.testing.assert_allclose(sample.q, motion(later)[0][50])


def test_a_pause_starts_the_window_anew() -> None:
    t = np.concatenate([np.arange(150), np.arange(400, 450)]) / RATE
    window = filled(CentredWindow(2, RATE, 1.0), t, *motion(t)[:2])
    assert window.middle() is None
    assert window.ignored == 0


@pytest.mark.parametrize("count", [100, 3, 5])
def test_windows_without_a_middle_or_too_short_are_refused(count: int) -> None:
    if count == 5:
        assert polynomial_weights(7, 0.1).shape == (3, 7)
        return
    with pytest.raises(UsageError, match="odd number"):
        polynomial_weights(count, 0.01)
