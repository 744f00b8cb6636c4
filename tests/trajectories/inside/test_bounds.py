"""The bound of a Fourier trajectory holds at every time, of every order and degree, ramp or not."""

from __future__ import annotations

import numpy as np
import pytest

from etude.trajectories import FourierTrajectory, riesz_range
from etude.trajectories.fourier import PEAK_BEND, PEAK_PRODUCT


def example(rng: np.random.Generator, ramped: bool) -> FourierTrajectory:
    harmonics = int(rng.integers(1, 9))
    table = rng.standard_normal((2 * harmonics + 1, 3)) * 10.0 ** rng.uniform(-1, 1, (1, 3))
    omega0 = float(10.0 ** rng.uniform(-0.5, 0.5))
    ramp = float(rng.uniform(0.2, 5.0)) if ramped else 0.0
    return FourierTrajectory(table, omega0, max(2.0 * np.pi / omega0, 2.0 * ramp) + 1.0, ramp)


def outside(motion: FourierTrajectory, t: np.ndarray) -> float:
    """How far, relative to their size, values leave what is proved; <= 0 inside."""
    worst, orders = -1.0, motion.motion(t, 4).orders
    shift = np.array([0.3, -2.0, 9.81])
    for order in range(4):
        values, amplitudes, kappa = motion.bound(order)
        low, high = riesz_range(values, kappa, amplitudes)
        size = np.abs(np.stack([low, high])).max(axis=0)
        beyond = np.maximum(low - orders[order].min(axis=0), orders[order].max(axis=0) - high)
        worst = max(worst, float(np.max(beyond / size)))
        # and of the size of a vector with a constant part, from squares of twice the degree
        values, amplitudes, kappa = motion.bound(order, 2)
        square = ((values + shift) ** 2).sum(axis=1)[:, None]
        high = riesz_range(square, kappa, float(((amplitudes + np.abs(shift)) ** 2).sum()))[1]
        dense = ((orders[order] + shift) ** 2).sum(axis=1)
        worst = max(worst, float((dense.max() - high[0]) / high[0]))
    return worst


@pytest.mark.parametrize("ramped", [pytest.param(False, marks=pytest.mark.slow), True], ids=["plain", "ramp"])
def test_the_bound_holds_at_a_hundred_thousand_instants(ramped: bool) -> None:
    rng = np.random.default_rng(0)
    for _ in range(6):
        motion = example(rng, ramped)
        assert outside(motion, np.linspace(0.0, motion.duration, 100_000)) <= 0.0


@pytest.mark.slow
@pytest.mark.parametrize("ramped", [False, True], ids=["plain", "ramp"])
def test_the_bound_holds_at_ten_million_instants(ramped: bool) -> None:
    rng = np.random.default_rng(1)
    for _ in range(100):
        motion = example(rng, ramped)
        assert outside(motion, np.linspace(0.0, motion.duration, 100_000)) <= 0.0


def test_without_a_ramp_the_bound_is_close() -> None:
    """No more than 0.2 % above what is reached over a period."""
    rng = np.random.default_rng(2)
    for _ in range(20):
        motion = example(rng, False)
        orders = motion.motion(np.linspace(0.0, 2.0 * np.pi / motion.omega0, 20_001), 6).orders
        for order in range(6):
            values, amplitudes, kappa = motion.bound(order)
            low, high = riesz_range(values, kappa, amplitudes)
            assert np.all(high - low <= 1.002 * np.ptp(orders[order], axis=0))


def test_a_ramp_as_hard_as_it_can_be_is_nearly_reached() -> None:
    """Where the series moves fast in the middle of a ramp, acceleration comes near p' c."""
    motion = FourierTrajectory(np.array([[0.0], [1.0], [0.0]]), 0.05, 20.0, 1.0)
    reached = np.abs(motion.motion(np.linspace(0.0, 20.0, 100_001)).orders[2]).max()
    values, _, kappa = motion.bound(2)
    assert reached > 0.99 * np.abs(values).max() / kappa


@pytest.mark.parametrize("omega0", [0.5, 1.2, 4.0])
def test_jerk_is_bounded_for_whatever_a_ramp_does_within_its_extremes(omega0: float) -> None:
    """Also where its third derivative counts and its rate does not, as at its beginning."""
    ramp, table = 2.0, np.array([[0.0], [1.0], [-1.0], [2.0], [1.0]])  # lopsided: up is not down
    values, amplitudes, kappa = FourierTrajectory(table, omega0, 20.0, ramp).bound(3)
    low, high = riesz_range(values, kappa, amplitudes)
    plain = FourierTrajectory(table, omega0, 2.0 * np.pi / omega0)
    _, first, second, third = plain.motion(np.linspace(0.0, plain.duration, 1001), 4).orders
    for rate in (0.0, 0.4, 1.0):
        for product in (-1.0, 1.0):
            for bend in (-1.0, 1.0):
                jerk = rate**3 * third + 3.0 * product * PEAK_PRODUCT / ramp * second
                jerk = jerk + bend * PEAK_BEND / ramp**2 * first
                assert low[0] <= jerk.min()
                assert jerk.max() <= high[0]
