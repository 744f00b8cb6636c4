"""The centred window: derivatives of polynomials are exact, the delay half a window, bad input stays out."""

from __future__ import annotations

import numpy as np
import pytest

from etude.errors import UsageError
from etude.types import Channel
from etude_online.row_samples import ORDER, CentredWindow, Source, polynomial_weights, sources

RATE = 100.0
CHANNELS = {
    "q": Channel("q", ("a", "b"), ("rad", "rad")),
    "qd": Channel("qd", ("a", "b"), ("rad/s", "rad/s"), derivative_of="q"),
    "qdd": Channel("qdd", ("a", "b"), ("rad/s^2", "rad/s^2"), derivative_of="qd"),
    "jerk": Channel("jerk", ("a", "b"), ("rad/s^3", "rad/s^3"), derivative_of="qdd"),
    "command": Channel("command", ("a", "b"), ("A", "A"), "command"),
}
WANTED = ("q", "qd", "qdd", "command")


def window(joints: int = 2) -> CentredWindow:
    found = sources(WANTED, ("q", "command"), CHANNELS)
    return CentredWindow(found, {"q": joints, "command": joints}, RATE, 1.0)


def filled(window: CentredWindow, t: np.ndarray, q: np.ndarray, command: np.ndarray) -> CentredWindow:
    for time, *values in zip(t, q, command, strict=True):
        window.push(time, dict(zip(("q", "command"), values, strict=True)))
    return window


def motion(t: np.ndarray) -> tuple[np.ndarray, ...]:
    """A cubic and a parabola: value, first and second derivative."""
    q = np.column_stack([1.0 + 2.0 * t - t**2 + 0.3 * t**3, 4.0 - t + 0.5 * t**2])
    qd = np.column_stack([2.0 - 2.0 * t + 0.9 * t**2, -1.0 + t])
    qdd = np.column_stack([-2.0 + 1.8 * t, np.ones_like(t)])
    return q, qd, qdd


def middle(window: CentredWindow) -> tuple[float, dict[str, np.ndarray]]:
    found = window.middle()
    assert found is not None
    return found


def test_a_channel_is_measured_or_the_rate_of_what_is() -> None:
    found = sources(("qdd", "q", "command"), ("q", "command"), CHANNELS)
    assert found == [Source("qdd", "q", 2), Source("q", "q", 0), Source("command", "command", 0)]
    assert sources(("qdd",), ("q", "qd"), CHANNELS) == [Source("qdd", "qd", 1)]  # the nearest one
    assert sources(("qd",), ("q", "qd"), CHANNELS) == [Source("qd", "qd", 0)]


@pytest.mark.parametrize("name", ["jerk", "lift"])
def test_what_is_neither_is_refused(name: str) -> None:
    with pytest.raises(UsageError, match=f"'{name}', which is neither") as refused:
        sources((name,), ("q", "command"), CHANNELS)
    assert "q, command" in str(refused.value)


def test_polynomials_up_to_the_order_are_differentiated_exactly() -> None:
    t = 3.0 + np.arange(170) / RATE
    q, qd, qdd = motion(t)
    time, row = middle(filled(window(), t, q, 5.0 * q))
    place = 170 - 51
    assert time == pytest.approx(t[place])
    for name, wanted in zip(WANTED, (q, qd, qdd, 5.0 * q), strict=True):
        np.testing.assert_allclose(row[name], wanted[place], rtol=1e-9, atol=1e-9)


def test_weights_are_those_of_a_least_squares_polynomial() -> None:
    y = np.random.default_rng(0).normal(size=31)
    t = 0.02 * np.arange(-15, 16)
    fitted = np.polynomial.Polynomial.fit(t, y, ORDER)
    wanted = [fitted(0.0), fitted.deriv(1)(0.0), fitted.deriv(2)(0.0)]
    np.testing.assert_allclose(polynomial_weights(31, 0.02) @ y, wanted, rtol=1e-8)


def test_position_and_command_are_smoothed_alike() -> None:
    noise = np.random.default_rng(1).normal(size=(101, 1))
    _, row = middle(filled(window(1), np.arange(101) / RATE, noise, noise))
    np.testing.assert_array_equal(row["q"], row["command"])
    assert abs(row["q"][0]) < 0.6  # averages: one deviation would be 1


def test_nothing_comes_before_the_window_is_full() -> None:
    t = np.arange(100) / RATE
    own = filled(window(), t, *(motion(t)[:2]))
    assert own.middle() is None
    filled(own, np.ones(1), np.zeros((1, 2)), np.zeros((1, 2)))
    assert own.middle() is not None


def test_a_stuck_clock_is_ignored_and_counted_and_spoils_nothing() -> None:
    t = np.arange(150) / RATE
    q, qd, _ = motion(t)
    clean, stuck = (filled(window(), t, q, qd) for _ in range(2))
    for time in (t[-1], t[-1] - 0.5):
        filled(stuck, np.array([time]), np.full((1, 2), 99.0), np.zeros((1, 2)))
    assert (clean.ignored, stuck.ignored) == (0, 2)
    np.testing.assert_array_equal(middle(clean)[1]["q"], middle(stuck)[1]["q"])


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_measurement_that_is_not_finite_starts_the_window_anew(bad: float) -> None:
    t = np.arange(150) / RATE
    q, qd, _ = motion(t)
    own = filled(window(), t, q, qd)
    filled(own, np.array([1.5]), np.array([[0.0, bad]]), np.zeros((1, 2)))
    assert own.ignored == 1
    assert own.middle() is None
    later = 1.51 + np.arange(101) / RATE
    _, row = middle(filled(own, later, motion(later)[0], motion(later)[1]))
    np.testing.assert_allclose(row["q"], motion(later)[0][50])


def test_a_pause_starts_the_window_anew() -> None:
    t = np.concatenate([np.arange(150), np.arange(400, 450)]) / RATE
    own = filled(window(), t, *motion(t)[:2])
    assert own.middle() is None
    assert own.ignored == 0


@pytest.mark.parametrize("count", [100, 3, 5])
def test_windows_without_a_middle_or_too_short_are_refused(count: int) -> None:
    if count == 5:
        assert polynomial_weights(7, 0.1).shape == (3, 7)
        return
    with pytest.raises(UsageError, match="odd number"):
        polynomial_weights(count, 0.01)
