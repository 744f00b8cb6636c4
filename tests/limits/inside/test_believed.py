"""A model's deviations are not believed so far that they refuse what the robot has done."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from test_commands import LIMIT, SWING, pendulum

from etude.limits import CommandLimit
from etude.limits.commands import (
    BELIEVED_ROOM,
    LEAST_BELIEVED,
    LOOK,
    SELDOM,
    after_run,
    credible,
    held_at,
    rest_at,
    weight_at,
)
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
    assert any("is used, b" in sentence for sentence in held.not_verified)
    motion = limit.along(SWING, LOOK)
    room = BELIEVED_ROOM * (8.0 - np.abs(pendulum(motion)))
    assert np.min((room - held.spread(motion, SWING.duration, SELDOM))[:, 1]) == pytest.approx(0.0, abs=1e-12)


def test_a_model_that_agrees_with_what_was_run_is_believed_in_full() -> None:
    limit = vague(0.01)
    assert after_run([limit, LIMIT], SWING) == [limit, LIMIT]


def test_some_of_a_deviation_counts_always() -> None:
    np.testing.assert_array_equal(credible(vague(1e6), SWING), [1.0, LEAST_BELIEVED])


def test_a_run_leaves_no_more_of_a_deviation_than_home_did() -> None:
    limit, home = vague(6.0), np.array([0.5, 0.5])
    held = held_at(limit, home)
    (ran,) = after_run([held], SWING)
    assert isinstance(ran, CommandLimit)
    assert held.share is not None
    assert ran.share is not None
    np.testing.assert_allclose(ran.share, held.share * credible(held, SWING))
    assert ran.share[1] < held.share[1] < 1.0
    assert ran.keeps(SWING)


def test_of_an_assumed_deviation_counts_what_home_leaves_room_for() -> None:
    """Of 8 N m gravity takes 4 sin q; a deviation that lasts is the same at all times."""
    limit, home = replace(vague(3.0), lasts=math.inf), np.array([0.5, 0.5])
    held = held_at(limit, home)
    room, spread = 8.0 - 4.0 * math.sin(0.5), limit.beyond(0.0) * 3.001
    assert held.share is not None
    np.testing.assert_allclose(held.share, [1.0, BELIEVED_ROOM * room / spread])
    assert "is used, b " in held.gaps[-1]
    assert held_at(replace(vague(0.5), lasts=math.inf), home).share is None
    # at a pose that the mean alone excludes nothing is made of the deviation: that is another refusal
    assert held_at(replace(limit, upper=np.full(2, 1.0), lower=-np.full(2, 1.0)), home).share is None
    poses = np.array([[0.5, 0.5], [0.0, 0.0]])
    weight = weight_at(limit, poses)
    np.testing.assert_array_equal(weight > 1.0, [True, True])
    assert weight[1] == pytest.approx(spread / BELIEVED_ROOM / 8.0)
    np.testing.assert_array_equal(held.blocked("", home), "")
    assert limit.blocked("", home) == "the torque of b with its deviation"
    assert replace(limit, upper=np.full(2, 1.0)).blocked("", home) == "the torque of a"
    assert len(rest_at(poses, 3).t) == 2
