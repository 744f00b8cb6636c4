"""Margins of tracking: the rule, the start, and what there is room for."""

from __future__ import annotations

import numpy as np
import pytest

from etude.errors import UsageError
from etude.limits import (
    APPROACH,
    COLLISIONS,
    HIDDEN,
    Ranges,
    TrackingConfig,
    in_words,
    margins_of,
    within_room,
)
from etude.limits.certificate import ALL, COMMANDS, TRACKING, not_verified
from etude.limits.tracking_margins import CONFIDENCE, factor, learned_table, start_table
from etude.trajectories import Chain, PointToPoint
from etude.types import Proof

LOWER, UPPER, HOME = np.array([-2.0, 0.0]), np.array([2.0, 1.0]), np.array([0.0, 0.2])
RANGES = Ranges.of((LOWER, UPPER), (np.array([-1.0, -3.0]), np.array([1.0, 3.0])), HOME, ("rad", "m"))


def test_the_fewer_logs_the_larger_the_factor() -> None:
    assert [factor(n) for n in (1, 2, 3, 4, 8)] == [3.0, 2.0, 2.0, 1.5, 1.5]


def test_the_largest_of_the_last_eight_counts() -> None:
    logs = [np.full((3, 2), float(e)) for e in (9, 1, 2, 1, 1, 1, 1, 1, 1)]
    table, confidence = learned_table(logs, RANGES)
    np.testing.assert_array_equal(table, [[3.0, 3.0], [3.0 + HIDDEN, 3.0 + 3.0 * HIDDEN]])
    np.testing.assert_array_equal(confidence, np.full((2, 2), CONFIDENCE))
    assert learned_table(logs[:8], RANGES)[0][0, 0] == 1.5 * 9.0
    assert learned_table(logs[:1], RANGES)[0][0, 0] == 3.0 * 9.0


def test_before_any_log_a_part_of_each_range_or_what_the_gains_allow() -> None:
    """Of a joint that turns further than half a turn, a part of half a turn."""
    table, confidence = start_table(TrackingConfig(position=0.1, velocity=0.2), RANGES, None)
    np.testing.assert_allclose(table, [[0.1 * np.pi, 0.1], [0.2, 0.6]])
    assert not confidence.any()
    table, confidence = start_table(TrackingConfig(), RANGES, np.array([0.3, np.nan]))
    np.testing.assert_allclose(table[0], [0.3, 0.02])
    np.testing.assert_array_equal(confidence, [[1.0, 0.0], [0.0, 0.0]])


def test_none_leaves_less_than_half_of_the_way_from_home() -> None:
    table = np.array([[0.9, 0.9], [0.6, 0.1]])
    kept, confidence = within_room(table, np.full((2, 2), 0.95), RANGES)
    np.testing.assert_allclose(kept, [[0.9, 0.1], [0.5, 0.1]])
    np.testing.assert_array_equal(confidence, [[0.95, 0.0], [0.0, 0.95]])


def test_forms_are_kept_apart_and_may_all_be_left_out() -> None:
    errors = {"fourier": [np.full((3, 2), 0.01)]}
    found = margins_of(TrackingConfig(), RANGES, errors, ("fourier", "moves"))
    np.testing.assert_allclose(found["fourier"][0], [[0.03, 0.03], [0.03 + HIDDEN, 0.03 + 3.0 * HIDDEN]])
    assert not np.any(found["moves"][1])
    told = margins_of(TrackingConfig(margin="assumed"), RANGES, errors, ("fourier",))
    np.testing.assert_array_equal(told["fourier"][0], found["moves"][0])
    assert margins_of(TrackingConfig(margin="none"), RANGES, errors, ("fourier",)) == {}


def test_a_velocity_that_nobody_limits_has_no_margin() -> None:
    free = Ranges.of((LOWER, UPPER), None, HOME)
    table, confidence = within_room(*start_table(TrackingConfig(), free, None), free)
    assert np.isnan(table[1]).all()
    np.testing.assert_array_equal(learned_table([np.full((3, 2), 0.1)], free)[0], np.full((2, 2), 3.0 * 0.1))
    np.testing.assert_allclose(table[0], [0.08, 0.02])
    assert confidence.shape == (2, 2)


@pytest.mark.parametrize("bad", [{"margin": "some"}, {"position": 0.3}, {"velocity": -0.1}])
def test_impossible_settings_are_refused(bad: dict[str, object]) -> None:
    with pytest.raises(UsageError, match=next(iter(bad))):
        TrackingConfig(**bad)  # type: ignore[arg-type]


def row(quantity: str = "position", margin: float = 0.0, confidence: float = 1.0) -> Proof:
    lower, upper = -2.76, 2.76
    return Proof("a", quantity, lower, upper, -1.0, 2.71, "", tracking_margin=margin, confidence=confidence)


def test_a_row_in_words() -> None:
    assert in_words(row()) == "planned 2.71, limit 2.76"
    assert in_words(row(margin=0.04, confidence=0.95)) == (
        "planned 2.71, tracking margin 0.04 with 95 % confidence, limit 2.8"
    )
    assert (
        in_words(row(margin=0.04, confidence=0.0)) == "planned 2.71, tracking margin 0.04, assumed, limit 2.8"
    )
    low = Proof("a", "position", -0.9, 0.9, -0.8, 0.1, "", tracking_margin=0.1, confidence=1.0)
    assert in_words(low) == "planned -0.8, tracking margin 0.1, limit -1"


class Looking:
    """Stands in for a limit."""

    def __init__(self, *looks_at: str, left_out: tuple[str, ...] = ()) -> None:
        self.looks_at, self.not_verified = looks_at, left_out


def test_what_is_looked_at_is_not_said() -> None:
    alone = PointToPoint(np.array([[0.0], [1.0]]), 1.0)
    back = PointToPoint(np.array([[1.0], [0.0]]), 1.0)
    assert not_verified(alone, [], [row()]) == ALL
    kept = not_verified(alone, [], [row(margin=0.1, confidence=0.95)], ["More."])
    assert TRACKING not in kept
    assert kept[-1] == "More."
    assumed = not_verified(alone, [], [row(margin=0.1, confidence=0.0)])
    assert "no log" in assumed[0]
    assert "velocity" in not_verified(alone, [], [row(margin=0.1), row("velocity")])[0]
    limits = [Looking(COMMANDS), Looking(COLLISIONS, left_out=("Cables.",))]
    found = not_verified(alone, limits, [row()])  # type: ignore[arg-type]
    assert COMMANDS not in found
    assert COLLISIONS not in found
    assert "Cables." in found
    there = Chain((("approach", back), ("segment", alone), ("return", back)))
    assert APPROACH not in not_verified(there, [], [row()])
    assert APPROACH in not_verified(Chain((("approach", back), ("segment", alone))), [], [row()])
