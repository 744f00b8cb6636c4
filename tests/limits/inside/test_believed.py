"""A model's deviations are not believed so far that they refuse what the robot has done."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_commands import LIMIT, SWING, pendulum

from etude.limits import CommandLimit
from etude.limits.commands import BELIEVED_ROOM, LEAST_BELIEVED, LOOK, SELDOM, after_run, credible
from etude.types import Array, Motion


def vague(size: float) -> CommandLimit:
    """Deviations that are large where joint b turns round, and next to none of joint a."""

    def deviation(motion: Motion) -> Array:
        turns = np.exp(-((motion.orders[1] / 0.1) ** 2))
        return np.asarray(turns * np.array([1e-3, size]) + 1e-3)

    return replace(LIMIT, deviation=deviation, _proofs={})


def test_with_what_is_believed_the_motion_that_was_run_is_kept_with_room_to_spare() -> None:
    limit = vague(2.0)
    full, (held,) = limit.prove(SWING), after_run([limit], SWING)
    assert not limit.keeps(SWING)
    assert full[1].proved_lower < -8.0
    assert held.keeps(SWING)
    a, b = held.prove(SWING)
    assert b.proved_lower > -8.0
    assert b.proved_upper < 8.0
    assert (a.proved_lower, a.proved_upper) == (full[0].proved_lower, full[0].proved_upper)
    assert any("deviations there count b" in sentence for sentence in held.not_verified)
    motion = limit.along(SWING, LOOK)
    room = BELIEVED_ROOM * (8.0 - np.abs(pendulum(motion)))
    assert np.min((room - held.spread(motion, SWING.duration, SELDOM))[:, 1]) == pytest.approx(0.0, abs=1e-12)


def test_a_model_that_agrees_with_what_was_run_is_believed_in_full() -> None:
    limit = vague(0.01)
    assert after_run([limit, LIMIT], SWING) == [limit, LIMIT]


def test_some_of_a_deviation_counts_always() -> None:
    np.testing.assert_array_equal(credible(vague(1e6), SWING), [1.0, LEAST_BELIEVED])
