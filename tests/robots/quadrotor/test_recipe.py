"""Lag of the motors and the rate of the model."""

from dataclasses import replace

import numpy as np
import pytest

from etude.errors import DataError
from etude.logs.flight.lag import command_lag, without_lag
from etude.logs.flight.log import FlightLog
from etude.logs.flight.sampling import sampled_flight
from etude.models.flight.preprocess import FlightDataConfig, common_lag
from etude.robots.toml_file import load_robot
from etude.trajectories.flight.states import FlightStates

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


def test_flights_share_their_lag_and_short_ones_have_no_say():
    several = [flight(0.04, noise=1e-3, seconds=20.0, seed=k) for k in range(3)]
    assert command_lag(*several) == pytest.approx(0.04, abs=1e-3)
    other = flight(0.15, noise=1e-3, seconds=1.0)
    assert command_lag(*several, other) == command_lag(*several)
    assert command_lag(other) == command_lag() == 0.0


def test_a_battery_that_sags_and_noise_do_not_move_the_lag():
    log = flight(0.04, noise=0.3)
    tired = replace(log, command=log.command + 3.0 * (log.t[:, None] / log.t[-1]) ** 2)
    assert np.ptp(tired.command, axis=0).max() > 1.2 * np.ptp(log.command, axis=0).min()
    assert command_lag(tired) == pytest.approx(0.04, abs=3e-3)


def test_a_motor_with_a_time_constant_lags_by_it():
    """Speed follows its set-point as 1 / (1 + T s): at frequencies below 1 / T that is a delay of T."""
    constant, t = 0.05, np.arange(0.0, 30.0, 0.005)
    w, phase = np.linspace(0.7, 6.0, 9), np.linspace(0.0, 5.0, 9)
    follows = np.sin(w * t[:, None] + phase)
    asked = follows + constant * w * np.cos(w * t[:, None] + phase)
    X = np.column_stack([follows, np.zeros((len(t), 0))])
    log = FlightLog(
        t, FlightStates(None, X[:, :3], X[:, 3:6], X[:, 6:]), asked @ MIX, ("a", "b", "c", "d"), "1"
    )
    assert command_lag(log) == pytest.approx(constant, abs=3e-3)


def test_the_lag_is_measured_only_in_logs_faster_than_the_model():
    spec = replace(load_robot("quadrotor").flight, rate=10.0)
    slow, fast = flight(0.1, rate=19.0, seconds=60.0), flight(0.1)
    assert command_lag(slow) == pytest.approx(0.1, abs=0.01)
    assert common_lag([slow], spec, FlightDataConfig()) == 0.0
    assert common_lag([slow, fast], spec, FlightDataConfig()) == pytest.approx(0.1, abs=1e-3)
    assert common_lag([fast], spec, FlightDataConfig(lag_s=0.03)) == 0.03


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
