"""Is this the log of that flight? Shifts are found, other flights and broken-off ones are refused."""

from dataclasses import replace

import numpy as np
import pytest

from etude.errors import DataError
from etude.logs.flight.identity import align_flight
from etude.logs.flight.log import FlightLog
from etude.robots.toml_file import load_robot
from etude.trajectories.flight.family import FlightFamily
from etude.trajectories.flight.feasible import feasible_flights
from etude.trajectories.flight.samplers import uniform_parameters
from etude.trajectories.flight.states import FlightStates

SPEC = load_robot("quadrotor").flight
FAMILY = FlightFamily()
FLIGHTS = [
    FAMILY.trajectory(p)
    for p in uniform_parameters(np.random.default_rng(5), feasible_flights(SPEC, FAMILY), 3)
]


def log_of(trajectory, start=0.0, stop=30.0, away=0.3, clock=0.0, rate=20.0):
    """A flight `away` m from its plan, recorded from `start` to `stop`, its clock shifted."""
    t = np.arange(start, stop, 1.0 / rate)
    wanted = trajectory.sample(np.clip(t, 0.0, trajectory.duration)).q
    rows = np.ones((len(t), 3))
    position = wanted + away * np.sin(t)[:, None]
    states = FlightStates(position[:, 2], rows, rows, rows)
    return FlightLog(t + clock, states, np.ones((len(t), 4)), SPEC.command_names, "V", position)


def test_a_fitting_log_keeps_its_clock():
    log = align_flight(log_of(FLIGHTS[0]), FLIGHTS[0], SPEC)
    assert log.repairs == ()
    np.testing.assert_allclose(log.position_des, FLIGHTS[0].sample(log.t).q)


def test_a_recorder_that_ran_before_and_after_is_cut_and_shifted():
    log = align_flight(log_of(FLIGHTS[0], start=-12.0, stop=40.0, clock=100.0), FLIGHTS[0], SPEC)
    assert "starts 100" in log.repairs[0]
    assert log.t[0] >= -0.03
    assert log.t[-1] <= 30.03
    np.testing.assert_allclose(log.position, log.position_des, atol=0.5)


def test_another_flight_is_refused():
    with pytest.raises(DataError, match="not the log of the proposed flight"):
        align_flight(log_of(FLIGHTS[1]), FLIGHTS[0], SPEC)


def test_a_flight_that_broke_off_is_refused_and_says_where():
    sentence = "The flight was cut: the vehicle hit the ground after 9.1 s at (1, 2, 0) m."
    log = replace(log_of(FLIGHTS[0], stop=9.1), repairs=(sentence,))
    with pytest.raises(DataError, match=r"hit the ground after 9\.1 s"):
        align_flight(log, FLIGHTS[0], SPEC)


def test_a_log_without_positions_is_taken_at_its_word():
    log = replace(log_of(FLIGHTS[0]), position=None)
    assert align_flight(log, FLIGHTS[1], SPEC) is log
