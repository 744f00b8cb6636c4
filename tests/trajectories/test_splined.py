"""Curves that receivers make of points: what meets where, how close, and what bounds them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BPoly, CubicHermiteSpline

from etude.errors import UsageError
from etude.trajectories import FourierTrajectory, Splined

T = np.array([0.0, 0.3, 0.7, 1.5, 1.6])
POINTS = np.random.default_rng(4).normal(size=(4, 5, 2))
INSIDE = np.linspace(0.0, 1.6, 333)


def series() -> FourierTrajectory:
    """20 s, five harmonics."""
    table = np.random.default_rng(1).normal(size=(11, 3)) * 0.2
    return FourierTrajectory(table, 2 * np.pi / 20.0, 20.0)


@pytest.mark.parametrize("orders", [1, 2, 3, 4])
def test_it_is_the_hermite_interpolant(orders: int) -> None:
    found = Splined(T, POINTS[:orders]).motion(INSIDE, 4).orders
    other = BPoly.from_derivatives(T, np.moveaxis(POINTS[:orders], 0, 1))
    for order in range(orders):
        expected = other.derivative(order)(INSIDE) if order else other(INSIDE)
        np.testing.assert_allclose(found[order], expected, rtol=1e-9, atol=1e-9)


def test_cubics_are_those_of_another_library() -> None:
    found = Splined(T, POINTS[:2]).motion(INSIDE, 1).orders[0]
    np.testing.assert_allclose(found, CubicHermiteSpline(T, POINTS[0], POINTS[1])(INSIDE), atol=1e-12)


@pytest.mark.parametrize("orders", [2, 3, 4])
@pytest.mark.parametrize("step", [0.2, 0.1])
def test_it_is_as_close_to_a_series_as_its_sixth_derivative_allows(orders: int, step: float) -> None:
    motion = series()
    t = np.arange(0.0, 20.0 + 1e-9, step)
    fine = np.linspace(0.0, 20.0, 5001)
    played = Splined(t, motion.motion(t, orders).orders).motion(fine, 1).orders[0]
    n = 2 * orders
    top = np.abs(motion.motion(fine, n + 1).orders[n]).max()
    # the Hermite remainder: |f^(n)|/n! times the largest (u (1 - u) h^2)^orders
    bound = top / np.prod(np.arange(1.0, n + 1)) * (step / 2.0) ** n
    error = np.abs(played - motion.motion(fine, 1).orders[0]).max()
    assert 0.1 * bound < error <= bound + 1e-13


@pytest.mark.parametrize("orders", [1, 2, 3, 4])
def test_control_points_hold_what_they_bound_and_little_more(orders: int) -> None:
    curve = Splined(T, POINTS[:orders])
    values = curve.motion(np.linspace(0.0, 1.6, 100_001), orders + 1).orders
    for order in range(curve.bounded):
        held = curve.bound(order, 1)[0]
        assert np.all(held.min(axis=0) <= values[order].min(axis=0) + 1e-12)
        assert np.all(held.max(axis=0) >= values[order].max(axis=0) - 1e-12)
        slack = np.ptp(held, axis=0) / np.ptp(values[order], axis=0)
        assert slack.max() < (1.06 if order == 0 else 1.35)


def test_a_derivative_that_jumps_without_bound_is_refused() -> None:
    lines, held = Splined(T, POINTS[:1]), Splined(T, POINTS[:2], held=True)
    for curve, order in ((lines, 2), (held, 2)):
        curve.bound(order - 1)
        with pytest.raises(UsageError, match=f"nothing bounds derivative {order}"):
            curve.bound(order)


def test_what_is_held_is_the_last_point_order_by_order() -> None:
    held = Splined(T, POINTS[:2], held=True)
    found = held.motion(np.array([0.0, 0.29, 0.3, 1.59, 1.6, 9.0]), 3).orders
    np.testing.assert_array_equal(found[0], POINTS[0][[0, 0, 1, 3, 4, 4]])
    np.testing.assert_array_equal(found[1][:5], POINTS[1][[0, 0, 1, 3, 4]])
    assert not found[1][5].any()
    assert not found[2].any()
    np.testing.assert_array_equal(held.bound(1)[0], POINTS[1])


@pytest.mark.parametrize(
    ("times", "points", "named"),
    [
        (T, POINTS[:, :4], "do not belong"),
        (T[:1], POINTS[:, :1], "do not belong"),
        (T, np.zeros((5, 5, 1)), "1 to 4 orders"),
        (T[::-1], POINTS, "increase from 0"),
        (T + 1.0, POINTS, "increase from 0"),
        (np.where(T == 0.7, np.nan, T), POINTS, "not a finite"),
        (T, np.where(POINTS[1, 2, 0] == POINTS, np.inf, POINTS), "not a finite"),
    ],
)
def test_points_that_make_no_curve_are_refused(times, points, named: str) -> None:
    with pytest.raises(UsageError, match=named):
        Splined(times, points)
