from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etude.errors import UsageError
from etude.trajectories import FourierTrajectory, from_json
from etude.trajectories.fourier import rest_nullspace, series


def example(seed: int = 0, harmonics: int = 4, dof: int = 2, ramp: float = 0.0) -> FourierTrajectory:
    table = np.random.default_rng(seed).standard_normal((2 * harmonics + 1, dof))
    return FourierTrajectory(table, 0.6, 12.0, ramp)


def test_position_is_the_printed_series() -> None:
    motion = example()
    for t in (0.0, 0.37, 5.1, 12.0):
        for j in range(2):
            table = motion.coefficients[:, j]
            q = table[0]
            for i in range(1, 5):
                w = 0.6 * i
                q += table[i] / w * math.sin(w * t) - table[4 + i] / w * math.cos(w * t)
            assert motion.motion(np.array([t])).orders[0, 0, j] == pytest.approx(q, abs=1e-13)


def test_one_sine_has_a_velocity_of_its_coefficient() -> None:
    motion = FourierTrajectory(np.array([[0.5], [2.0], [0.0]]), 0.3, 10.0)
    start = motion.motion(np.zeros(1), 6).orders[:, 0, 0]
    np.testing.assert_allclose(start, [0.5, 2.0, 0.0, -2.0 * 0.3**2, 0.0, 2.0 * 0.3**4], atol=1e-15)


@pytest.mark.parametrize(("ramp", "orders"), [(0.0, 7), (2.5, 4)])
@pytest.mark.parametrize("harmonics", [1, 2, 5, 10])
def test_every_rate_is_the_derivative_of_the_one_before(harmonics: int, ramp: float, orders: int) -> None:
    motion = example(harmonics, harmonics, ramp=ramp)
    t, h = np.linspace(0.05, 11.95, 200), 1e-3
    here, ahead, behind, ahead2, behind2 = (
        motion.motion(t + s, orders).orders for s in (0.0, h, -h, 2 * h, -2 * h)
    )
    slope = (8 * (ahead - behind) - ahead2 + behind2) / (12 * h)
    away = (np.abs(t - 2.5) > 0.01) & (np.abs(t - 9.5) > 0.01)  # the jerk has a corner where a ramp ends
    for low in range(orders - 1):
        exact = here[low + 1, away]
        np.testing.assert_allclose(slope[low, away], exact, rtol=0, atol=1e-7 * np.abs(exact).max())


def test_a_ramp_has_no_snap() -> None:
    with pytest.raises(UsageError, match="orders 1 to 4, not 5"):
        example(ramp=2.0).motion(np.zeros(1), 5)
    with pytest.raises(UsageError, match="nothing bounds derivative 4"):
        example(ramp=2.0).bound(4)


@pytest.mark.parametrize("ramp", [0.0, 2.5])
def test_the_motion_is_linear_in_its_coefficients(ramp: float) -> None:
    t = np.linspace(-1.0, 13.0, 77)
    one, two = example(1, ramp=ramp), example(2, ramp=ramp)
    both = FourierTrajectory(2.0 * one.coefficients - 3.0 * two.coefficients, 0.6, 12.0, ramp)
    mixed = 2.0 * one.motion(t, 4).orders - 3.0 * two.motion(t, 4).orders
    np.testing.assert_allclose(both.motion(t, 4).orders, mixed, atol=1e-12)


@pytest.mark.parametrize("ramp", [0.0, 2.5])
def test_slowed_down_it_is_the_same_path(ramp: float) -> None:
    motion, t = example(ramp=ramp), np.linspace(0.0, 12.0, 77)
    slow = motion.slowed(1.7)
    assert slow.duration == 1.7 * 12.0
    mine, theirs = slow.motion(1.7 * t).orders, motion.motion(t).orders
    for order in range(3):
        np.testing.assert_allclose(mine[order], theirs[order] / 1.7**order, atol=1e-12)


@given(st.integers(2, 10), st.integers(1, 4), st.integers(0, 10**6))
@settings(max_examples=40, deadline=None)
def test_null_space_starts_and_ends_at_rest(harmonics: int, periods: int, seed: int) -> None:
    free = rest_nullspace(harmonics)
    assert free.shape == (2 * harmonics + 1, 2 * harmonics - 1)
    np.testing.assert_allclose(free.T @ free, np.eye(free.shape[1]), atol=1e-12)
    table = free @ np.random.default_rng(seed).standard_normal((free.shape[1], 2))
    motion = FourierTrajectory(table, 0.4, periods * 2.0 * np.pi / 0.4)
    q, qd, qdd = motion.motion(np.array([0.0, motion.duration])).orders
    assert np.abs(qd).max() < 1e-11
    assert np.abs(qdd).max() < 1e-10
    np.testing.assert_allclose(q[0], q[1], atol=1e-11)


def test_the_null_space_holds_every_rest_start() -> None:
    table = np.array([0.3, 1.0, -2.0, 1.0, 3.0, 0.0, -1.0])  # sum a = 0, b_1 + 3 b_3 = 0
    free = rest_nullspace(3)
    np.testing.assert_allclose(free @ (free.T @ table), table, atol=1e-12)


@given(st.integers(1, 10), st.floats(0.05, 3.0), st.floats(0.1, 6.0), st.integers(0, 10**6))
@settings(max_examples=60, deadline=None)
def test_a_ramp_rests_at_both_ends_whatever_the_series(
    harmonics: int, omega0: float, ramp: float, seed: int
) -> None:
    table = np.random.default_rng(seed).standard_normal((2 * harmonics + 1, 2))
    motion = FourierTrajectory(table, omega0, 12.0, ramp)
    assert not motion.motion(np.array([0.0, 12.0])).orders[1:].any()


def test_it_rests_outside_its_duration() -> None:
    for ramp in (0.0, 2.0):
        motion = example(ramp=ramp)
        outside, ends = (motion.motion(np.array(t), 4).orders for t in ([-3.0, 40.0], [0.0, 12.0]))
        np.testing.assert_array_equal(outside[0], ends[0])
        assert not outside[1:].any()


@given(
    st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=5, max_size=5),
    st.floats(1e-300, 1e300),
)
@settings(max_examples=100, deadline=None)
def test_json_keeps_every_bit(column: list[float], omega0: float) -> None:
    motion = FourierTrajectory(np.array(column)[:, None], omega0, 60.0, 0.1)
    again = from_json(motion.to_json().encode())
    assert isinstance(again, FourierTrajectory)
    assert again == motion
    assert hash(again) == hash(motion)
    assert again.coefficients.tobytes() == motion.coefficients.tobytes()


def test_a_trajectory_cannot_be_changed_from_outside() -> None:
    table = np.zeros((3, 1))
    motion = FourierTrajectory(table, 1.0, 10.0)
    table[0] = 5.0
    assert motion.coefficients[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        motion.coefficients[0, 0] = 1.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.zeros((4, 1)), 1.0, 10.0), r"shape \(4, 1\)"),
        ((np.zeros(5), 1.0, 10.0), r"shape \(5,\)"),
        ((np.full((3, 1), np.nan), 1.0, 10.0), "not a finite number"),
        ((np.zeros((3, 1)), 0.0, 10.0), "omega0"),
        ((np.zeros((3, 1)), np.inf, 10.0), "omega0"),
        ((np.zeros((3, 1)), 1.0, -1.0), "duration"),
        ((np.zeros((3, 1)), 1.0, 10.0, 5.1), "ramps of 5.1 s do not fit"),
        ((np.zeros((3, 1)), 1.0, 10.0, -1.0), "ramps"),
    ],
)
def test_bad_input(arguments: tuple[object, ...], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        FourierTrajectory(*arguments)


def test_one_harmonic_has_no_rest_start() -> None:
    with pytest.raises(UsageError, match="at least 2 harmonics"):
        rest_nullspace(1)


def test_series_rows_do_not_depend_on_the_constant_beyond_position() -> None:
    rows = series(np.linspace(0.0, 6.0, 9), 3, 0.5, 6)
    assert np.all(rows[0][:, 0] == 1.0)
    assert not any(row[:, 0].any() for row in rows[1:])
