"""Words of recipes over whole logs: grid, lag, rate, trimming, thinning and masks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from etude.errors import DataError
from etude.logs import duration, without_lag
from etude.logs.cleaning.filters import (
    command_lag,
    differentiated,
    longest_stretch,
    looked_at,
    sampled,
    saturated,
    slower,
    thinned,
    trimmed,
    uniform,
)
from etude.types import Channel, Log

MIX = np.random.default_rng(3).normal(size=(9, 4))
STATES = ("specific_force", "rates", "angular_acceleration", "altitude")
XYZ = ("x", "y", "z")
CHANNELS = {
    **{name: Channel(name, XYZ, ("1",) * 3) for name in STATES[:3]},
    "command": Channel("command", ("a", "b", "c", "d"), ("1",) * 4, "command"),
}


def states_of(X, t, command):
    values = {name: X[:, 3 * i : 3 * i + 3] for i, name in enumerate(STATES[:3])}
    return Log(t, CHANNELS, {**values, "command": command}, "flight")


def flight(lag, rate=200.0, seconds=20.0, noise=0.01, seed=0):
    """Commands that lead the motion they cause by `lag` s: a linear vehicle with a pure delay."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    frequency, phase = rng.uniform(0.5, 6.0, size=(9, 4)), rng.uniform(0, 6, size=(9, 4))

    def motion(times):
        return np.stack(
            [np.sin(times[:, None] * f + p).sum(axis=1) for f, p in zip(frequency, phase, strict=True)], 1
        )

    return states_of(motion(t) + noise * rng.normal(size=(len(t), 9)), t, motion(t + lag) @ MIX)


@pytest.mark.parametrize("lag", [0.0, 0.0275, 0.04, 0.101])
def test_a_known_lag_is_found_between_samples(lag):
    assert command_lag([flight(lag, noise=1e-3)], STATES) == pytest.approx(lag, abs=1e-3)


def test_without_its_lag_a_log_has_none_and_is_explained():
    log = without_lag(flight(0.04, noise=0.0), 0.04)
    assert command_lag([log], STATES) == pytest.approx(0.0, abs=1e-3)
    X = np.hstack([log[name] for name in STATES[:3]])
    np.testing.assert_allclose(log["command"], X @ MIX, atol=1e-3 * np.abs(X @ MIX).max())


def test_logs_share_their_lag_and_short_ones_have_no_say():
    several = [flight(0.04, noise=1e-3, seconds=20.0, seed=k) for k in range(3)]
    assert command_lag(several, STATES) == pytest.approx(0.04, abs=1e-3)
    other = flight(0.15, noise=1e-3, seconds=1.0)
    assert command_lag([*several, other], STATES) == command_lag(several, STATES)
    assert command_lag([other], STATES) == command_lag([], STATES) == 0.0


def test_a_battery_that_sags_and_noise_do_not_move_the_lag():
    log = flight(0.04, noise=0.3)
    tired = log.put(CHANNELS["command"], log["command"] + 3.0 * (log.t[:, None] / log.t[-1]) ** 2)
    assert np.ptp(tired["command"], axis=0).max() > 1.2 * np.ptp(log["command"], axis=0).min()
    assert command_lag([tired], STATES) == pytest.approx(0.04, abs=3e-3)


def test_a_motor_with_a_time_constant_lags_by_it():
    """Speed follows its set-point as 1 / (1 + T s): at frequencies below 1 / T that is a delay of T."""
    constant, t = 0.05, np.arange(0.0, 30.0, 0.005)
    w, phase = np.linspace(0.7, 6.0, 9), np.linspace(0.0, 5.0, 9)
    follows = np.sin(w * t[:, None] + phase)
    asked = follows + constant * w * np.cos(w * t[:, None] + phase)
    assert command_lag([states_of(follows, t, asked @ MIX)], STATES) == pytest.approx(constant, abs=3e-3)


def test_a_slow_or_short_log_says_nothing():
    assert command_lag([flight(0.04, rate=4.0)], STATES) == 0.0
    assert command_lag([flight(0.04, seconds=1.0)], STATES) == 0.0
    with pytest.raises(DataError, match="shorter than a lag"):
        without_lag(flight(0.0, seconds=1.0), 2.0)


def test_means_are_of_each_interval_and_points_of_its_start():
    log = flight(0.0)
    mean, point = sampled(log, 10.0), sampled(log, 10.0, averaged=False)
    assert len(mean) == len(point) == 200
    np.testing.assert_allclose(mean["command"][1], log["command"][20:40].mean(axis=0))
    np.testing.assert_array_equal(point["rates"], log["rates"][::20])
    assert mean.t[0] == pytest.approx(log.t[:20].mean())
    assert list(mean.values) == list(log.values)


def test_a_log_at_the_models_rate_is_left_alone():
    log = flight(0.0, rate=10.0)
    assert sampled(log, 10.0) is log
    assert sampled(log, 7.0) is log


def test_a_grid_of_the_longest_stretch():
    log = flight(0.0, rate=100.0)
    assert uniform(log).t == pytest.approx(log.t, abs=1e-12)
    np.testing.assert_allclose(uniform(log)["rates"], log["rates"], atol=1e-9)
    paused = replace(log, t=np.where(np.arange(len(log)) < 600, log.t, log.t + 3.0))
    found = uniform(paused)
    assert "the longest part, 1400 rows" in found.repairs[0]
    assert found.t[0] == pytest.approx(9.0)
    assert longest_stretch(log) is log
    assert duration(paused) == pytest.approx(19.98)
    assert len(uniform(log, 50.0)) == 1000


def test_angles_that_wrap_and_quaternions_that_change_sign_are_interpolated():
    t = np.arange(0.0, 10.0, 0.1)
    yaw = np.angle(np.exp(1j * 2.0 * t))[:, None]
    sign = np.where(np.arange(len(t)) % 7 < 3, 1.0, -1.0)
    quaternion = sign[:, None] * np.column_stack([np.cos(t), np.sin(t), 0 * t, 0 * t])
    channels = (
        Channel("attitude", ("yaw",), ("rad",), "aside"),
        Channel("orientation", ("w", "x", "y", "z"), ("1",) * 4, "aside"),
    )
    log = Log(t, {c.name: c for c in channels}, {"attitude": yaw, "orientation": quaternion})
    fine = uniform(log, 40.0)
    turned = np.exp(1j * fine["attitude"][:, 0])
    np.testing.assert_allclose(turned, np.exp(2j * fine.t), atol=1e-9)
    assert np.linalg.norm(fine["orientation"], axis=1).min() > 0.99


def test_a_derivative_is_a_channel_like_another():
    log = flight(0.0, noise=0.0)
    other = Channel("rates_rate", XYZ, ("1/s",) * 3, derivative_of="rates")
    slope = differentiated(log, "rates", other, 50.0)["rates_rate"]
    inner = slice(100, -100)
    np.testing.assert_allclose(slope[inner], np.gradient(log["rates"], log.t, axis=0)[inner], atol=0.05)


def test_trimming_and_what_is_left():
    log = flight(0.0, rate=10.0)
    cut = trimmed(replace(log, t=log.t + 7.0), 2.0, 3.0)
    assert (cut.t[0], cut.t[-1]) == pytest.approx((9.0, 23.9))
    with pytest.raises(DataError, match="no rows of the log remain"):
        trimmed(log, 15.0, 15.0)


def test_thinning_keeps_the_rate_and_moves_its_start():
    assert thinned(100.0, 8.0) == slice(0, None, 12)
    assert thinned(5.0, 8.0, 3) == slice(0, None, 1)
    starts = [thinned(1000.0, 10.0, number).start for number in range(10)]
    assert len(set(starts)) == 10
    assert max(np.diff(sorted(starts))) < 20


def test_masks():
    speed = np.array([[0.1, 3.0], [1.0, 0.2], [-2.0, -0.01]])
    still = slower(speed, np.array([10.0, 1.0]), 0.1)
    np.testing.assert_array_equal(still, [[True, False], [False, False], [False, True]])
    lower, upper = np.zeros(2), np.array([1.0, 10.0])
    near = saturated(np.array([[0.0, 5.0], [0.5, 9.995], [1.2, -1.0]]), lower, upper)
    np.testing.assert_array_equal(near, [[True, False], [False, True], [True, True]])


@pytest.mark.parametrize(("rows", "rate"), [(300_000, 200.0), (1_000_000, 1000.0), (4_000_000, 4000.0)])
def test_of_a_very_long_log_stretches_are_looked_at(rows: int, rate: float) -> None:
    """So that no check costs more, however long it is; each is long enough to hold some motion."""
    log = Log(np.arange(rows) / rate, {}, {}, "long")
    found = looked_at(log)
    starts = np.concatenate([[0], np.flatnonzero(np.diff(found.t) > 1.5 / rate) + 1])
    lengths = np.diff([*starts, len(found)])
    assert len(found) <= 10 * max(10_000, 10.0 * rate)
    assert len(starts) >= 10
    assert lengths.min() / rate >= 9.9
    assert found.t[0] == log.t[0]
    assert found.t[-1] == log.t[-1]
    short = log.take(slice(0, 200_000))
    assert looked_at(short) is short
