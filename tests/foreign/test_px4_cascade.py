"""The stand-in of PX4's position controller keeps the laws of the one that it stands in for."""

from __future__ import annotations

import numpy as np
import pytest
from px4_cascade import Body, G, Parameters, PositionControl, constrained, fly, padded

HOVER = np.array([0.0, 0.0, -2.0, *np.zeros(6)])


def test_it_hovers_where_it_is_told_to_also_with_a_wrong_hover_thrust() -> None:
    still = np.repeat(HOVER[None], 50, axis=0)
    flown = fly(padded([still], 50.0, 1.0, 1.0))
    assert np.abs(flown.position - flown.setpoint).max() < 1e-12
    heavy = fly(padded([still], 50.0, 1.0, 20.0), body=Body(hover=0.55))
    assert np.abs(heavy.position - heavy.setpoint).max() > 0.05, "it sags first"
    assert np.abs(heavy.position - heavy.setpoint)[-1].max() < 1e-3, "and the integral finds it"


@pytest.mark.slow
def test_small_steps_answer_as_the_linear_loop_does() -> None:
    """z: 1/s^2 behind the motors' lag, acceleration 4 (1 (r - z) - v) + 2 int(1 (r - z) - v)."""
    from scipy.signal import TransferFunction, step

    lag = Body().motors
    # v' = f, f' = (u - f)/lag, u = (4 + 2/s)((r - z) - s z): closed loop from r to z
    closed = TransferFunction([4.0, 2.0], [lag, 1.0, 4.0, 4.0 + 2.0, 2.0])
    rows = np.repeat(HOVER[None], 500, axis=0)
    rows[1:, 2] -= 0.01
    flown = fly(padded([rows], 50.0, 0.0, 0.0), dt=0.002)
    t, expected = step(closed, T=np.linspace(0.0, 9.9, 991))
    found = np.interp(t + 0.02, flown.t, -(flown.position[:, 0, 2] + 2.0)) / 0.01
    assert np.abs(found - expected).max() < 0.02


def test_velocity_is_cut_along_the_feedforward_not_along_the_error() -> None:
    rng = np.random.default_rng(0)
    first, second = rng.normal(size=(2, 1000, 2)) * 5.0
    out = constrained(first, second, 4.0)
    sizes = np.linalg.norm(out, axis=1)
    assert sizes.max() <= 4.0 + 1e-9
    short = np.linalg.norm(first + second, axis=1) <= 4.0
    np.testing.assert_allclose(out[short], (first + second)[short])
    cut = ~short & (np.linalg.norm(first, axis=1) < 4.0)
    np.testing.assert_allclose(sizes[cut], 4.0)
    kept = out[cut] - first[cut]
    assert np.abs(kept[:, 0] * second[cut, 1] - kept[:, 1] * second[cut, 0]).max() < 1e-9


def test_thrust_points_as_asked_until_tilt_and_size_end_it() -> None:
    control, zero = PositionControl((1,)), np.zeros((1, 3))
    level = control.thrust((zero, zero, zero), (zero, zero, np.array([[3.0, 4.0, -1.0]])), 0.01)
    np.testing.assert_allclose(level[0] * G / 0.5, [3.0 * (G + 1) / G, 4.0 * (G + 1) / G, -(G + 1.0)])
    steep = PositionControl((1,)).thrust((zero, zero, zero), (zero, zero, np.array([[90.0, 0.0, 0.0]])), 0.01)
    assert np.arctan2(steep[0, 0], -steep[0, 2]) == pytest.approx(Parameters().tilt_air)
    assert np.linalg.norm(steep) <= 1.0


def test_a_take_off_begins_with_the_ramp() -> None:
    """It pushes as much as it weighs when the ramp of its speed passes zero: 9.81/4 of 9.81/4 + 3 in 3 s."""
    rows = np.repeat(HOVER[None], 1000, axis=0)
    rows[:, 2] = -np.minimum(np.arange(1000) * 0.02 * 0.5, 2.0)
    flown = fly(padded([rows], 50.0, 0.0, 0.0), ground=np.zeros(1))
    up = flown.t[np.argmax(flown.position[:, 0, 2] < -1e-3)]
    assert 1.2 < up < 2.2
    assert abs(flown.position[-1, 0, 2] + 2.0) < 0.02
