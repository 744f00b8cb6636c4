"""How far a prediction is trusted."""

from __future__ import annotations

import numpy as np

from etude.models import trusted
from etude.models.trust import REACH, TRUSTED, UNKNOWN, smoothstep, training_range_weight, trust


def test_trust_falls_smoothly_from_one_to_nothing() -> None:
    ratio = np.linspace(0.0, 1.5, 301)
    weight = trust(np.column_stack([ratio * 4.0]), np.array([2.0]))[:, 0]
    assert (weight[ratio <= TRUSTED] == 1.0).all()
    assert (weight[ratio >= UNKNOWN] == 0.0).all()
    assert (np.diff(weight) <= 0.0).all()
    assert np.abs(np.diff(weight, 2)).max() < 2e-3  # no jump in the first derivative


def test_smoothstep_is_flat_at_both_ends() -> None:
    h = 1e-4
    for end in (0.0, 1.0):
        inside = end + h if end == 0.0 else end - h
        assert abs(float(smoothstep(np.array(inside))) - end) < 20 * h**3
    assert smoothstep(np.array(0.5)) == 0.5


def test_where_nothing_is_known_the_safe_command_is_what_remains() -> None:
    mean, safe = np.full((2, 2), 3.0), np.array([[1.0, -1.0], [0.5, 0.0]])
    variance = np.array([[0.0, 10.0], [10.0, 0.0]])
    found = trusted(mean, variance, np.ones(2), safe)
    np.testing.assert_array_equal(found, [[3.0, -1.0], [0.5, 3.0]])


def test_where_nothing_was_to_be_learned_the_command_is_a_number() -> None:
    """A process without signal beside physics: its variance is all noise, which does not count."""
    safe = np.array([[0.5, -2.0]])
    found = trusted(safe, np.array([[0.0, 1e-17]]), np.zeros(2), safe)
    np.testing.assert_array_equal(found, safe)


def test_familiar_inputs_are_those_within_the_ranges() -> None:
    ranges = np.array([[0.0, -1.0], [2.0, 1.0]])
    X = np.array([[1.0, 0.0], [2.0, 1.0], [2.0 + 2.0 * REACH, 0.0], [1.0, -9.0], [2.0 + REACH, 0.0]])
    found = training_range_weight(X, ranges)
    np.testing.assert_array_equal(found[:4], [1.0, 1.0, 0.0, 0.0])
    assert found[4] == 0.5
