"""Short stretches of right logs are not asked about: few samples of slow signals are independent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_motion import COMMAND, RATE, moved

from etude.logs import Seen
from etude.logs.checks import command_columns
from etude.logs.checks.filtered_motion import memory
from etude.logs.checks.plausibility import commanded, judge_commands
from etude.types import Array, Log

SECONDS = 7.0
SEEDS = range(60)


def seen_of(log: Log) -> Seen:
    found = commanded(log)
    assert found is not None
    return found


def carrying(seed: int, seconds: float = SECONDS) -> Log:
    """Three joints that carry weights, without friction and inertia: slow commands, none of their motion."""
    log = moved(seconds, seed=seed)
    rng = np.random.default_rng([seed, 1])
    angle = 2.0 * np.pi * rng.uniform(0.1, 0.25, 3) * log.t[:, None] + rng.uniform(0.0, 2.0 * np.pi, 3)
    return log.put(COMMAND, np.sin(angle) + 0.01 * rng.standard_normal(angle.shape))


@pytest.mark.parametrize("likeness", [0.0, 0.6, 0.9])
def test_memory_is_that_of_a_first_order_noise(likeness: float) -> None:
    rng = np.random.default_rng(0)
    noise = rng.standard_normal((100_000, 2))
    values = np.empty_like(noise)
    values[0] = noise[0]
    for i in range(1, len(noise)):
        values[i] = likeness * values[i - 1] + noise[i]
    expected = 0.02 * (1.0 + likeness) / (1.0 - likeness)
    np.testing.assert_allclose(memory(values, 0.02), expected, rtol=0.12)


def test_a_constant_remembers_nothing_that_counts() -> None:
    np.testing.assert_array_equal(memory(np.ones((50, 1)), 0.1), 0.1)


def remembering(rng: np.random.Generator, shape: tuple[int, int], rows: int) -> Array:
    """Noise of which neighbours within `rows` are alike."""
    noise = rng.standard_normal((shape[0] + rows, shape[1]))
    sums = np.cumsum(noise, axis=0)
    return np.asarray(sums[rows:] - sums[:-rows])


def test_the_error_of_the_power_is_that_of_independent_powers() -> None:
    """Of commands that have nothing to do with the motion, rho strays as far as is said."""
    one, rng = seen_of(moved(20.0)), np.random.default_rng(0)
    several = [replace(one, command=remembering(rng, one.q.shape, 20)) for _ in range(200)]
    rho = np.array([command_columns.agreement(each) for each in several])
    said = np.array([command_columns.by_chance(each) for each in several])
    # up to its first zero an autocorrelation is a little too long, on the safe side: 11 % here
    assert np.sqrt((rho**2).mean()) == pytest.approx(np.sqrt((said**2).mean()), rel=0.15)


@pytest.mark.parametrize(("seconds", "told"), [(0.2, True), (20.0, False)])
def test_a_power_of_few_turns_tells_no_sign(seconds: float, told: bool) -> None:
    """Taken out for most of the time: in many turns that is a sign, in one it is chance."""
    one = seen_of(moved(20.0))
    turn = ((one.t - one.t[0]) / seconds) % 1.0
    driven = np.where(turn < 0.72, -1.0, 1.0)[:, None] * np.sign(one.qd)
    found = replace(one, command=driven)
    assert (command_columns.agreement(found) < -command_columns.SURE).all()
    assert (command_columns.powered(found) < 0.0).all() == told
    assert (command_columns.powered(found) != 0.0).any() == told


def asked(one: Seen) -> bool:
    return command_columns.swap_finding(one).light == "yellow"


def test_commands_without_friction_are_not_asked_about() -> None:
    wrong = [seed for seed in SEEDS if asked(seen_of(carrying(seed)))]
    assert wrong == []


def pairs(log: Log) -> list[Array]:
    return [log["command"][:, order] for order in ([1, 0, 2], [2, 1, 0], [0, 2, 1])]


@pytest.mark.parametrize(("seconds", "least"), [(14.0, 0.6), (20.0, 0.8), (40.0, 0.9)])
def test_exchanged_commands_are_found_in_longer_ones(seconds: float, least: float) -> None:
    found = [
        asked(seen_of(log.put(COMMAND, own)))
        for seed in range(8)
        for log in [moved(seconds, seed=seed)]
        for own in pairs(log)
    ]
    assert np.mean(found) > least


def test_joints_that_move_for_a_moment_say_nothing_of_the_order() -> None:
    log = moved(6.0)
    still = np.arange(len(log)) > 1.0 * RATE
    q, qd = log["q"].copy(), log["qd"].copy()
    q[still, 1:], qd[still, 1:] = q[int(RATE), 1:], 0.0
    held = log.put(log.channels["q"], q).put(log.channels["qd"], qd)
    found = command_columns.swap_finding(seen_of(held))
    assert found.light == "cannot tell"
    assert "long enough" in found.sentence


def test_an_order_in_doubt_is_called_neither_right_nor_wrong_and_tells_no_sign() -> None:
    log = moved(10.0)
    exchanged = log.put(COMMAND, log["command"][:, [1, 0, 2]])
    order = command_columns.order_of(seen_of(exchanged))
    assert order is not None
    assert command_columns.DOUBT < order.margin < command_columns.MARGIN
    assert not order.named
    found = {finding.check: finding for finding in judge_commands(exchanged)}
    assert found["swapped"].light == found["sign"].light == "cannot tell"
    assert "hip and knee fit each other's joints a little better" in found["swapped"].sentence
    assert "neither is a sign" in found["sign"].sentence
    assert not found["swapped"].flag
    right = {finding.check: finding.light for finding in judge_commands(log)}
    assert right["swapped"] == "green"


def test_rows_backwards_are_offered_where_half_of_the_signs_are_wrong() -> None:
    """Without velocities; of four joints two may have been wrong before the rows were turned."""
    three, four = seen_of(moved(20.0, velocities=False)), [0, 1, 2, 0]
    values = {name: getattr(three, name)[:, four] for name in ("q", "qd", "qdd", "moving")}
    one = replace(three, **values, parts=("a", "b", "c", "d"), units=("rad",) * 4)
    for signs, offered in (([-1, -1, 1, 1], True), ([-1, 1, 1, 1], False)):
        found = command_columns.sign_finding(replace(one, command=np.sign(one.qd) * signs))
        assert ("backwards" in found.sentence) == offered
