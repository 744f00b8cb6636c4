"""Commands that hold weights and no friction: nothing in them says whose they are, so nobody is asked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_motion import COMMAND, QD, Q

from etude.logs import Seen
from etude.logs.checks import command_columns
from etude.logs.checks.plausibility import commanded, judge_commands
from etude.types import Array, Log

SECONDS, RATE = 60.0, 50.0
FREQUENCIES = np.array([2.0, 3.0, 4.0]) / SECONDS
SIZES = np.array([1.6, 1.5, 0.95])


def carrying(seed: int, dry: float = 0.0) -> Log:
    """One sine for each joint, whole periods; a serial arm's weights, which depend on all joints together.

    Torques behind the gear: 2 % noise, and friction of `dry` times their deviation.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(int(SECONDS * RATE)) / RATE
    angle = 2.0 * np.pi * FREQUENCIES * t[:, None] + rng.uniform(0.0, 2.0 * np.pi, 3)
    q = SIZES * np.sin(angle) + rng.uniform(-0.8, 0.8, 3)
    qd = SIZES * 2.0 * np.pi * FREQUENCIES * np.cos(angle)
    arm, hand = q[:, 0] + q[:, 1], q[:, 0] + q[:, 1] + q[:, 2]
    own = np.column_stack([30.0 * np.cos(q[:, 0]), 12.0 * np.cos(arm), 4.0 * np.cos(hand)])
    weight = np.cumsum(own[:, ::-1], axis=1)[:, ::-1]
    command = weight + weight.std(axis=0) * (
        dry * np.tanh(qd / 0.02) + 0.02 * rng.standard_normal(weight.shape)
    )
    return Log(t, {}, {}, "made").put(Q, q).put(QD, qd).put(COMMAND, command)


def seen_of(log: Log) -> Seen:
    found = commanded(log)
    assert found is not None
    return found


def order_of(log: Log) -> command_columns.Order:
    found = command_columns.order_of(seen_of(log))
    assert found is not None
    return found


def exchanged(log: Log, order: list[int]) -> Log:
    return log.put(COMMAND, np.ascontiguousarray(log["command"][:, order]))


PAIRS = ([1, 0, 2], [2, 1, 0], [0, 2, 1])
SEEDS = range(40)


def test_a_weight_that_fits_another_joints_motion_is_not_asked_about() -> None:
    orders = [order_of(carrying(seed)) for seed in SEEDS]
    assert (
        sum(order.margin > command_columns.MARGIN for order in orders) > 8
    )  # the likelihood alone would ask
    assert sum(order.named for order in orders) <= 1


def test_what_nobody_can_tell_is_said_and_stops_nothing() -> None:
    seed = next(seed for seed in SEEDS if order_of(carrying(seed)).margin > command_columns.MARGIN)
    found = {finding.check: finding for finding in judge_commands(carrying(seed))}
    assert found["swapped"].light == found["sign"].light == "cannot tell"
    assert not found["swapped"].flag
    assert "where no friction of a joint is seen in its command may be chance" in found["swapped"].sentence
    assert "model file" in found["swapped"].step


@pytest.mark.parametrize("order", PAIRS)
def test_with_friction_exchanged_commands_are_named(order: list[int]) -> None:
    found = [order_of(exchanged(carrying(seed, dry=1.0), order)) for seed in range(8)]
    named = [one.named and one.best.tolist() == np.argsort(order).tolist() for one in found]
    assert np.mean(named) > 0.8


def test_the_torque_of_a_model_file_ties_a_command_to_its_joint() -> None:
    log = carrying(3)
    torque: Array = seen_of(log).command  # type: ignore[assignment]
    for order in PAIRS:
        found = command_columns.order_of(seen_of(exchanged(log, order)), torque)
        assert found is not None
        assert found.named
        assert found.best.tolist() == np.argsort(order).tolist()


def test_a_coulomb_part_against_the_power_is_no_friction() -> None:
    """In phase with the speed, and yet no friction: less where a joint turns round, not more."""
    one = seen_of(carrying(0))
    speed = one.qd / np.abs(one.qd).max(axis=0)
    for coulomb, tied in ((-0.3, False), (0.3, True)):
        command = speed + coulomb * np.tanh(speed / 0.05)
        found = command_columns.order_of(replace(one, command=command))
        assert found is not None
        assert found.tied.tolist() == [tied] * 3
