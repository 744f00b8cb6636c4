from __future__ import annotations

import numpy as np
import pytest
from limit_examples import ARM_CONFIGS, ROOMS, arm, feasible_arm, flights, middle, room

from etude.limits import SAMPLERS, FeasibleSet, boundary, certify, scaled, timid, uniform
from etude.limits.samplers import amplitude

EVERY_ARM = pytest.mark.parametrize("config", ARM_CONFIGS.values(), ids=ARM_CONFIGS.keys())


def flight_set(**changes) -> FeasibleSet:
    limits = room(**changes)
    return FeasibleSet.of(limits, flights(), middle(limits))


@pytest.mark.parametrize("name", SAMPLERS)
def test_all_draw_members_that_are_certified(name: str) -> None:
    rng, limits = np.random.default_rng(0), arm(4)
    family, feasible = feasible_arm(limits, ARM_CONFIGS["null space"])
    for p in SAMPLERS[name](rng, feasible, 10):
        assert certify(family.trajectory(p), limits).ok
    limits = ROOMS["all"]
    feasible = FeasibleSet.of(limits, flights(), middle(limits))
    for p in SAMPLERS[name](rng, feasible, 10):
        assert certify(flights().trajectory(p), limits).ok


@pytest.mark.parametrize("name", SAMPLERS)
def test_the_same_seed_draws_the_same(name: str) -> None:
    feasible = flight_set()
    one, again = (SAMPLERS[name](np.random.default_rng(5), feasible, 3) for _ in range(2))
    np.testing.assert_array_equal(one, again)
    assert len({tuple(row) for row in one}) == 3


@EVERY_ARM
def test_scaled_motions_fill_each_joints_room(config) -> None:
    """The width of positions, or the peak of velocity or acceleration, whatever the offset."""
    rng, limits = np.random.default_rng(4), arm(4)
    family, feasible = feasible_arm(limits, config)
    for p in scaled(rng, feasible, 10):
        most = dict.fromkeys(limits[0].names, 0.0)
        for row in certify(family.trajectory(p), limits).rows:
            width = (row.proved_upper - row.proved_lower) / (row.upper - row.lower)
            peak = max(row.proved_upper / row.upper, row.proved_lower / row.lower)
            used = width if row.quantity == "position" else peak
            most[row.axis] = max(most[row.axis], used)
        np.testing.assert_allclose(list(most.values()), 1.0, atol=1.3e-3)


def test_offsets_are_drawn_over_the_room_that_is_left() -> None:
    limits = arm(4)
    family, feasible = feasible_arm(limits, ARM_CONFIGS["null space"])
    for sampler, least in ((scaled, 0.0), (amplitude, 0.2)):
        ends = []
        for p in sampler(np.random.default_rng(1), feasible, 200):
            rows = [r for r in certify(family.trajectory(p), limits).rows if r.quantity == "position"]
            ends.append([(r.proved_lower - r.lower) / (r.upper - r.lower) for r in rows])
        spread = np.ptp(ends, axis=0)
        assert np.all(spread > least)
        assert np.min(ends) >= 0.0


def test_random_amplitudes_are_smaller_and_differ_from_joint_to_joint() -> None:
    _, feasible = feasible_arm(arm(4), ARM_CONFIGS["null space"])
    full, part = (s(np.random.default_rng(0), feasible)[0] for s in (scaled, amplitude))
    moving = np.array([block.members[1] for block in feasible.blocks])
    ratio = part[moving] / full[moving]
    assert np.all((ratio > 0.1) & (ratio < 1.0))
    assert np.ptp(ratio) > 0.01


def test_uniform_flights_are_faster_than_timid_ones() -> None:
    """In the thesis's room timid flights make 1.0 m/s on average, uniform ones 1.8."""
    feasible, family, t = flight_set(), flights(), np.linspace(0.0, 30.0, 100)
    speeds = {}
    for sampler in (uniform, timid, boundary):
        drawn = [family.motion(p, t, 2).orders[1] for p in sampler(np.random.default_rng(6), feasible, 60)]
        speeds[sampler] = np.mean([np.linalg.norm(velocity, axis=1).mean() for velocity in drawn])
    assert speeds[timid] == pytest.approx(1.0, abs=0.15)
    assert speeds[uniform] == pytest.approx(1.85, abs=0.2)
    assert speeds[timid] < 0.7 * speeds[boundary] < speeds[uniform]


def test_the_walk_has_forgotten_its_start() -> None:
    """More steps change no quartile of the distance from the centre by more than sampling does."""
    feasible, uses = flight_set(), []
    for steps in (200, 300):
        points = uniform(np.random.default_rng(steps), feasible, 100, steps)
        uses.append(np.quantile([feasible.gauge(p)[0] for p in points], [0.25, 0.5, 0.75]))
    np.testing.assert_allclose(uses[0], uses[1], atol=0.04)


def test_pinned_draws() -> None:
    """The draws of 0.1 from the same seed."""
    feasible, some = flight_set(), [0, 4, 8, 12]
    edge = boundary(np.random.default_rng(9), feasible)[0, some]
    walk = uniform(np.random.default_rng(9), feasible, 1, 20)[0, some]
    expected = [-0.3921162395088154, 0.5584776674034007, 2.4709142201270886, -0.009060800806359594]
    np.testing.assert_allclose(edge, expected, rtol=1e-11)
    expected = [-0.1958287323625917, 0.42958169309635275, 2.463506326822763, -0.2650626819530815]
    np.testing.assert_allclose(walk, expected, rtol=1e-11)
