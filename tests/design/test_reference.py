from __future__ import annotations

import numpy as np
import pytest
from design_examples import FAMILIES, robot

from etude.design.reference import random_motions, reference_states
from etude.errors import UsageError
from etude.models.features import FeatureMap
from etude.trajectories.moves import PointToPoint, random_moves

FEATURES = FeatureMap(2, np.array([0.05, 0.05]))
STICK = np.array([0.05, 0.1])


def test_states_that_would_be_masked_are_dropped_per_output() -> None:
    moves = random_moves(np.random.default_rng(0), robot(), 6)
    references = reference_states(FEATURES, STICK, 40, [moves])
    for j, X in enumerate(references):
        assert X.shape == (40, 8)
        assert np.abs(X[:, 2 + j]).min() >= STICK[j]
    assert not np.array_equal(references[0], references[1])


def test_states_lie_on_the_motions() -> None:
    moves = PointToPoint(np.array([[0.0, 0.5], [0.6, 1.2]]), 0.4)
    X = reference_states(FEATURES, np.zeros(2), 50, [moves])[0]
    along = (X[:, 0] - 0.0) / 0.6
    np.testing.assert_allclose(X[:, 1], 0.5 + 0.7 * along, atol=1e-12)
    assert along.min() < 0.05
    assert along.max() > 0.95


def test_a_joint_that_never_moves_takes_its_states_from_elsewhere() -> None:
    still = PointToPoint(np.array([[0.0, 0.5], [0.0, 1.2]]), 0.4)
    others = random_motions(np.random.default_rng(1), robot(), FAMILIES["nullspace"], 3)
    references = reference_states(FEATURES, STICK, 30, [still], others)
    assert np.abs(references[0][:, 2]).min() >= STICK[0]
    np.testing.assert_array_equal(references[1][:, 0], np.zeros(30))
    alone = reference_states(FEATURES, STICK, 30, [still])
    assert len(alone[0]) == 30


def test_fewer_states_than_asked_for_are_not_repeated() -> None:
    still = PointToPoint(np.array([[0.0, 0.5], [0.0, 0.52]]), 0.4, dwell=3.0)
    fast = reference_states(FEATURES, np.array([0.05, 0.001]), 500, [still])
    assert len(np.unique(fast[1], axis=0)) == len(fast[1]) < 20


def test_random_motions_are_reproducible() -> None:
    made = [random_motions(np.random.default_rng(3), robot(), FAMILIES["nullspace"], 2) for _ in range(2)]
    assert made[0] == made[1]


def test_bad_input() -> None:
    with pytest.raises(UsageError, match="at least one motion"):
        reference_states(FEATURES, STICK, 10, [])
    with pytest.raises(UsageError, match="moves 1 joints"):
        reference_states(FEATURES, STICK, 10, [PointToPoint(np.array([[0.0], [1.0]]), 1.0)])
