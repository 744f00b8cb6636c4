"""Lag of the motors and the rate of the model."""

from dataclasses import replace

import numpy as np
import pytest

from etude.errors import DataError
from etude.logs.flight_lag import command_lag, without_lag
from etude.logs.flight_log import FlightLog
from etude.logs.flight_sampling import sampled_flight
from etude.trajectories.flight_states import FlightStates

MIX = np.random.default_rng(3).normal(size=(9, 4))


def flight(lag, rate=200.0, seconds=20.0, noise=0.01, seed=0):
    """Commands that lead the motion they cause by `lag` s: a linear vehicle with a pure delay."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    frequency, phase = rng.uniform(0.5, 6.0, size=(9, 4)), rng.uniform(0, 6, size=(9, 4))

    def motion(times):
        return np.stack(
            [np.sin(times[:, None] * f + p).sum(axis=1) for f, p in zip(frequency, phase, strict=True)], 1
        )

    X = motion(t) + noise * rng.normal(size=(len(t), 9))
    states = FlightStates(None, X[:, :3], X[:, 3:6], X[:, 6:])
    return FlightLog(t, states, motion(t + lag) @ MIX, ("a", "b", "c", "d"), "1")


@pytest.mark.parametrize("lag", [0.0, 0.0275, 0.04, 0.101])
def test_a_known_lag_is_found_between_samples(lag):
    assert command_lag(flight(lag, noise=1e-3)) == pytest.approx(lag, abs=1e-3)


def test_without_its_lag_a_flight_has_none_and_is_explained():
    log = without_lag(flight(0.04, noise=0.0), 0.04)
    assert command_lag(log) == pytest.approx(0.0, abs=1e-3)
    X = np.hstack([log.states.specific_force, log.states.rates, log.states.angular_acceleration])
    np.testing.assert_allclose(log.command, X @ MIX, atol=1e-3 * np.abs(X @ MIX).max())


def test_a_slow_or_short_log_says_nothing():
    assert command_lag(flight(0.04, rate=4.0)) == 0.0
    assert command_lag(flight(0.04, seconds=1.0)) == 0.0
    with pytest.raises(DataError, match="shorter than a lag"):
        without_lag(flight(0.0, seconds=1.0), 2.0)


def test_means_are_of_each_interval_and_points_of_its_start():
    log = replace(flight(0.0), position=np.arange(12000.0).reshape(4000, 3))
    mean, point = sampled_flight(log, 10.0), sampled_flight(log, 10.0, averaged=False)
    assert len(mean) == len(point) == 200
    np.testing.assert_allclose(mean.command[1], log.command[20:40].mean(axis=0))
    np.testing.assert_allclose(mean.position[0], log.position[:20].mean(axis=0))
    np.testing.assert_array_equal(point.states.rates, log.states.rates[::20])
    assert mean.t[0] == pytest.approx(log.t[:20].mean())
    assert mean.states.altitude is None


def test_a_log_at_the_models_rate_is_left_alone():
    log = flight(0.0, rate=10.0)
    assert sampled_flight(log, 10.0) is log
    assert sampled_flight(log, 7.0) is log
