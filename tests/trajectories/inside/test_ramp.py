from __future__ import annotations

import numpy as np
import pytest

from etude.trajectories.fourier import PEAK_BEND, PEAK_PRODUCT, PEAK_RATE, phase


def test_theta_advances_half_a_ramp_in_each_ramp() -> None:
    theta, rate, _, _ = phase(np.array([0.0, 3.0, 10.0, 17.0, 20.0]), 20.0, 3.0)
    np.testing.assert_allclose(theta, [0.0, 1.5, 8.5, 15.5, 17.0], atol=1e-14)
    np.testing.assert_allclose(rate, [0.0, 1.0, 1.0, 1.0, 0.0], atol=1e-14)


@pytest.mark.parametrize(("duration", "ramp"), [(20.0, 3.0), (6.0, 3.0), (60.0, 0.01)])
def test_rates_are_derivatives_and_time_never_runs_backwards(duration: float, ramp: float) -> None:
    t = np.linspace(0.0, duration, 20001)
    h = 1e-4 * ramp
    theta, rate, second, third = phase(t, duration, ramp)
    ahead, behind = phase(t + h, duration, ramp), phase(t - h, duration, ramp)
    inner = (t > h) & (t < duration - h)
    for low, exact in ((0, rate), (1, second), (2, third)):
        slope = (ahead[low] - behind[low]) / (2 * h)
        np.testing.assert_allclose(slope[inner], exact[inner], atol=1e-2 * max(np.abs(exact).max(), 1.0))
    assert np.all(np.diff(theta) >= 0.0)
    assert rate.min() >= 0.0
    assert rate.max() <= 1.0
    assert np.abs(second).max() <= PEAK_RATE / ramp
    assert np.abs(third).max() <= PEAK_BEND / ramp**2 * (1.0 + 1e-12)


def test_the_peak_rate_is_reached_in_the_middle_of_a_ramp() -> None:
    _, rate, second, _ = phase(np.array([1.0]), 10.0, 2.0)
    assert rate[0] == pytest.approx(0.5)
    assert second[0] == pytest.approx(PEAK_RATE / 2.0)


def test_without_a_ramp_theta_is_time() -> None:
    theta, rate, second, third = phase(np.array([-1.0, 0.0, 4.0, 9.0]), 8.0, 0.0)
    np.testing.assert_array_equal(theta, [0.0, 0.0, 4.0, 8.0])
    np.testing.assert_array_equal(rate, [0.0, 1.0, 1.0, 0.0])
    assert not second.any()
    assert not third.any()


def test_the_largest_product_of_rate_and_second_derivative() -> None:
    _, rate, second, _ = phase(np.linspace(0.0, 2.0, 100_001), 10.0, 2.0)
    largest = float((rate * second * 2.0).max())
    assert PEAK_PRODUCT - 1e-3 < largest <= PEAK_PRODUCT
