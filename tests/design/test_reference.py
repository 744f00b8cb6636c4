from __future__ import annotations

import numpy as np
import pytest
from design_examples import (
    arm_family,
    arm_inputs,
    arm_point,
    flight_family,
    flight_inputs,
    flight_point,
    moves,
)

from etude.design import reference_states
from etude.errors import UsageError
from etude.trajectories import PointToPoint

STICK = 0.05
ONE_EACH = [(0,), (1,)]


def test_states_that_would_be_masked_are_dropped_per_function() -> None:
    references = reference_states(arm_inputs(STICK), ONE_EACH, 40, [moves()])
    for j, X in enumerate(references):
        assert X.shape == (40, 8)
        assert np.abs(X[:, 2 + j]).min() >= STICK * (1.0 - 1e-9)
    assert not np.array_equal(references[0], references[1])


def test_states_lie_on_the_motions() -> None:
    straight = PointToPoint(np.array([[0.0, 0.5], [0.6, 1.2]]), 0.4)
    X = reference_states(arm_inputs(0.0), ONE_EACH, 50, [straight])[0]
    along = X[:, 0] / 0.6
    np.testing.assert_allclose(X[:, 1], 0.5 + 0.7 * along, atol=1e-12)
    assert along.min() < 0.05
    assert along.max() > 0.95


def test_a_joint_that_never_moves_takes_its_states_from_elsewhere() -> None:
    still, family = PointToPoint(np.array([[0.0, 0.5], [0.0, 1.2]]), 0.4), arm_family()
    rng = np.random.default_rng(1)
    others = [family.trajectory(arm_point(rng, family, 3.0)) for _ in range(3)]
    references = reference_states(arm_inputs(STICK), ONE_EACH, 30, [still], others)
    assert np.abs(references[0][:, 2]).min() >= STICK * (1.0 - 1e-9)
    np.testing.assert_array_equal(references[1][:, 0], np.zeros(30))
    assert len(reference_states(arm_inputs(STICK), ONE_EACH, 30, [still])[0]) == 30


def test_fewer_states_than_asked_for_are_not_repeated() -> None:
    still = PointToPoint(np.array([[0.0, 0.5], [0.0, 0.52]]), 0.4, dwell=3.0)
    fast = reference_states(arm_inputs(STICK), ONE_EACH, 500, [still])
    assert len(np.unique(fast[1], axis=0)) == len(fast[1]) < 20


def test_states_are_spread_over_all_motions() -> None:
    family, rng = flight_family(), np.random.default_rng(0)
    flights = [family.trajectory(flight_point(rng, family)) for _ in range(3)]
    (reference,) = reference_states(flight_inputs(), [(0, 1, 2, 3)], 30, flights)
    assert reference.shape == (30, 13)
    assert len(np.unique(reference[:, 0])) == 30
    for place, flight in enumerate(flights):
        t = 30.0 * (np.arange(1000) + 0.5) / 1000
        altitude = flight.motion(t, 1).orders[0][:, 2]
        assert all(np.abs(altitude - h).min() < 1e-12 for h in reference[10 * place : 10 * place + 10, 0])


def test_bad_input() -> None:
    with pytest.raises(UsageError, match="at least one motion"):
        reference_states(arm_inputs(), ONE_EACH, 10, [])
