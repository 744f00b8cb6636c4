"""A jerk limit of some joints: kept by what is proposed, by the ways there and by moves, and proved."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from etude.errors import UsageError
from etude.limits import FeasibleSet, certify, scaled
from etude.trajectories import FourierConfig, PointToPoint, from_json
from etude_arm import ArmSpec, Axis, motions
from etude_arm.description_checks import check_spec
from etude_arm.motions import approaches, family, limits
from etude_arm.robot_file import parse_robot, robot_to_toml

TIGHT = 0.6
SPEC = ArmSpec(
    "pair",
    (Axis("a", -1.0, 1.0, 1.0, 2.0, 9.0), Axis("b", -1.0, 1.0, 1.0, 2.0, 9.0, jerk=TIGHT)),
    "N m",
    50.0,
)
FREE = dataclasses.replace(SPEC, axes=tuple(dataclasses.replace(axis, jerk=None) for axis in SPEC.axes))


def drawn(spec: ArmSpec, config: FourierConfig):
    rng = np.random.default_rng(3)
    own = family(spec, config).drawn(rng)
    return own.trajectory(scaled(rng, FeasibleSet.of(limits(spec, {}), own, np.zeros(2)))[0])


@pytest.mark.parametrize(
    "config", [FourierConfig(), FourierConfig(2, 20.0, (0.4, 0.9), "ramp", 2.0)], ids=["rest", "ramp"]
)
def test_what_is_proposed_keeps_it_and_uses_it(config: FourierConfig) -> None:
    free, bound = (drawn(spec, config) for spec in (FREE, SPEC))
    jerk = [
        np.abs(m.motion(np.linspace(0.0, m.duration, 40_001), 4).orders[3, :, 1]).max() for m in (free, bound)
    ]
    assert jerk[0] > TIGHT
    assert 0.3 * TIGHT < jerk[1] <= TIGHT
    assert not certify(free, limits(SPEC, {})).ok
    (row,) = [row for row in certify(bound, limits(SPEC, {})).rows if row.quantity == "jerk"]
    assert (row.axis, row.status, row.upper) == ("b", "proved", TIGHT)
    assert jerk[1] <= max(-row.proved_lower, row.proved_upper) <= TIGHT


def test_the_ways_and_the_moves_of_tests_keep_it() -> None:
    motion = drawn(SPEC, FourierConfig())
    there, back = approaches(SPEC, motion, np.array([0.9, -0.9]))
    moves = motions.tests(SPEC, np.random.default_rng(0))["moves"]
    for way in (there, back, moves):
        assert certify(way, limits(SPEC, {})).ok
    assert not certify(approaches(FREE, motion, np.array([0.9, -0.9]))[0], limits(SPEC, {})).ok


def test_a_move_that_jerk_limits_takes_as_long_as_it_must() -> None:
    move = PointToPoint(np.array([[0.0], [2.0]]), 100.0, 0.0, 100.0, 3.0)
    assert move.duration == pytest.approx((60.0 * 2.0 / 3.0) ** (1.0 / 3.0))
    orders = move.motion(np.linspace(0.0, move.duration, 100_001), 4).orders
    assert np.abs(orders[3]).max() == pytest.approx(3.0, rel=1e-3)
    assert from_json(move.to_json()).duration == move.duration
    assert move.slowed(2.0).duration == pytest.approx(2.0 * move.duration)
    assert "peak_jerk" not in PointToPoint(np.array([[0.0], [2.0]]), 1.0).to_json()


def test_the_robot_file_keeps_it_and_refuses_nonsense(tmp_path) -> None:
    assert parse_robot(robot_to_toml(SPEC), where="", folder=tmp_path) == SPEC
    assert "jerk" not in robot_to_toml(FREE)
    wrong = dataclasses.replace(SPEC, axes=(dataclasses.replace(SPEC.axes[0], jerk=-1.0),))
    with pytest.raises(UsageError, match="'jerk' must be a finite number above zero"):
        check_spec(wrong)
