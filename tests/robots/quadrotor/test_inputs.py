"""Features and data sets of flights: columns, the way back, and flights that teach nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from inverse_flights import SPEC, flights, log_of, random_states

from etude.errors import DataError, UsageError
from etude.models.flight.dataset import flight_dataset
from etude.models.flight.features import FlightFeatures
from etude.trajectories.flight.states import FlightStates

ALL = [
    FlightFeatures(h, a, v)
    for h in (True, False)
    for a in ("specific_force", "kinematic")
    for v in (True, False)
]


def test_the_columns_of_the_thesis() -> None:
    states = random_states(np.random.default_rng(0))
    X = FlightFeatures(True, "kinematic", False).transform(states)
    assert X.shape == (len(states), 10)
    np.testing.assert_array_equal(X[:, 0], states.altitude)
    np.testing.assert_array_equal(X[:, 1:4], states.acceleration)
    np.testing.assert_array_equal(X[:, 4:7], states.rates)
    np.testing.assert_array_equal(X[:, 7:], states.angular_acceleration)
    assert [features.width for features in ALL] == [13, 10, 13, 10, 12, 9, 12, 9]


@pytest.mark.parametrize("features", ALL, ids=str)
def test_the_pullback_is_the_adjoint(features: FlightFeatures) -> None:
    rng = np.random.default_rng(2)
    states, change = random_states(rng, 3.0), random_states(rng, 3.0)
    G = rng.normal(size=(len(states), features.width))
    forward = np.sum(G * features.transform(change))
    back = features.pullback(states, G)
    backward = sum(np.sum(getattr(back, name) * part) for name, part in vars(change).items())
    assert forward == pytest.approx(backward, rel=1e-12)


def test_a_missing_quantity_names_the_option() -> None:
    states = random_states(np.random.default_rng(0))
    for name, option in {
        "altitude": "altitude = false",
        "velocity": "body_velocity = false",
        "acceleration": "specific_force",
    }.items():
        with pytest.raises(DataError, match=name) as refused:
            FlightFeatures(acceleration="kinematic").transform(replace(states, **{name: None}))
        assert option in refused.value.next_step
    bare = replace(states, altitude=None, velocity=None, acceleration=None)
    features = FlightFeatures(altitude=False, body_velocity=False)
    back = features.pullback(bare, features.transform(bare))
    assert back.altitude is None
    assert back.velocity is None
    with pytest.raises(UsageError):
        features.pullback(bare, np.zeros((len(bare), 10)))
    with pytest.raises(UsageError):
        FlightFeatures(acceleration="world")


def test_flights_are_joined_trimmed_and_timed() -> None:
    logs = [log_of(flights(1, seed=s)) for s in (0, 1)]
    late = replace(logs[1], t=logs[1].t + 100.0)
    data = flight_dataset([late, logs[0]], SPEC, first_s=2.0, last_s=1.0, numbers=[5, 3])
    assert data.flights.tolist() == [3, 5]
    assert data.t.min() == pytest.approx(2.0)
    assert data.t.max() == pytest.approx(28.9)
    np.testing.assert_array_equal(data.command[data.group == 3], logs[0].command[20:290])
    assert data.after(5.0).sum() == 2 * 240
    assert len(data.take(data.after(5.0))) == 480


def saturated(command: np.ndarray) -> np.ndarray:
    return np.column_stack([np.where(np.arange(len(command)) % 2, 0.0, 11.1), command[:, 1:]])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda log: replace(log, command=np.where(np.arange(300)[:, None] == 7, np.nan, log.command)),
            "command",
        ),
        (lambda log: replace(log, t=np.where(np.arange(300) == 7, np.inf, log.t)), "t contains"),
        (
            lambda log: replace(log, states=replace(log.states, rates=np.full((300, 3), np.nan))),
            "rates contains NaN",
        ),
        (lambda log: replace(log, command=np.full((300, 4), 5.9)), "no command ever changes"),
        (lambda log: replace(log, command=saturated(log.command)), "saturated throughout"),
    ],
)
def test_flights_that_teach_nothing_are_refused(change, words: str) -> None:
    with pytest.raises(DataError, match=words) as refused:
        flight_dataset([change(log_of(flights(1)))], SPEC)
    assert "flight.csv" in str(refused.value)


def test_no_flight_other_units_and_too_much_trimming_are_refused() -> None:
    log = log_of(flights(1))
    with pytest.raises(DataError, match="no flight"):
        flight_dataset([])
    with pytest.raises(DataError, match="different units"):
        flight_dataset([log, replace(log, command_unit="1")])
    with pytest.raises(DataError, match="nothing is left"):
        flight_dataset([log], first_s=40.0)


def test_one_constant_output_is_no_reason_to_refuse() -> None:
    log = log_of(flights(1))
    command = log.command.copy()
    command[:, 3] = 0.5
    assert isinstance(flight_dataset([replace(log, command=command)], SPEC).states, FlightStates)
