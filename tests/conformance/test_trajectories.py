"""What every trajectory owes. A new form is a row in TRAJECTORIES."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from etude.limits import AxisLimit, FeasibleSet, certify, scaled
from etude.trajectories import (
    FourierConfig,
    FourierFamily,
    PointToPoint,
    Splined,
    chained,
    from_json,
    random_moves,
    riesz_range,
)

NAMES = ("a", "b")
LOWER, UPPER = np.array([-1.0, 0.1]), np.array([0.5, 2.0])
SPEED, BEND = np.array([0.6, 1.0]), np.array([1.0, 3.0])
LIMITS = (
    AxisLimit("position", 0, NAMES, LOWER, UPPER),
    AxisLimit("velocity", 1, NAMES, -SPEED, SPEED, rest=True),
    AxisLimit("acceleration", 2, NAMES, -BEND, BEND),
)
RNG = np.random.default_rng(0)


def drawn(config: FourierConfig):
    family = FourierFamily.of(config, 2).drawn(RNG)
    feasible = FeasibleSet.of(LIMITS, family, 0.5 * (LOWER + UPPER))
    return family.trajectory(scaled(RNG, feasible)[0])


def splined(orders: int):
    motion = drawn(FourierConfig(duration=20.0)).slowed(1.05)
    t = np.linspace(0.0, motion.duration, 151)
    return Splined(t, motion.motion(t, orders).orders)


def linked(*segments):
    """A chain of the segments, with straight moves between them, once by a third pose."""
    links = []
    for number, (before, after) in enumerate(pairwise(segments)):
        ends = [m.motion(np.array([t]), 1).orders[0, 0] for m, t in ((before, before.duration), (after, 0.0))]
        stops = [ends[0], np.array([-0.2, 1.0]), ends[1]] if number else ends
        links.append([PointToPoint(np.stack(way), 0.9 * SPEED, 0.1, 0.9 * BEND) for way in pairwise(stops)])
    return chained(segments, links)


SINGLE = {
    "fourier, null space": drawn(FourierConfig(duration=20.0)),
    "fourier, phase ramp": drawn(FourierConfig(2, 20.0, (0.4, 0.9), "ramp", 2.0)),
    "moves": random_moves(RNG, LOWER, UPPER, SPEED, BEND, 4),
    "quintics": splined(3),
    "septics": splined(4),
}
TRAJECTORIES = {**SINGLE, "chain": linked(*SINGLE.values())}
EVERY = pytest.mark.parametrize("motion", TRAJECTORIES.values(), ids=TRAJECTORIES.keys())
ALONE = pytest.mark.parametrize("motion", SINGLE.values(), ids=SINGLE.keys())


@EVERY
def test_rates_are_derivatives(motion) -> None:
    t, h = np.linspace(0.01, motion.duration - 0.01, 301), 1e-5
    here, ahead, behind = (motion.motion(t + s, 4).orders for s in (0.0, h, -h))
    assert here.shape == (4, 301, 2)
    for low in range(3):
        slope, exact = (ahead[low] - behind[low]) / (2 * h), here[low + 1]
        wrong = np.abs(slope - exact).max(axis=1) > 1e-4 * np.abs(exact).max() + 1e-6
        # jerk may jump where a piece begins; nothing below it does
        assert np.count_nonzero(wrong) <= (2 if low == 2 else 0)


@EVERY
def test_fewer_orders_are_the_first_ones(motion) -> None:
    t = np.linspace(0.0, motion.duration, 17)
    for orders in (1, 2, 3):
        np.testing.assert_array_equal(motion.motion(t, orders).orders, motion.motion(t, 4).orders[:orders])
    assert motion.motion(t).orders.shape == (3, 17, 2)


@EVERY
def test_at_rest_at_both_ends_and_outside(motion) -> None:
    ends = motion.motion(np.array([0.0, motion.duration]), 4).orders
    assert np.abs(ends[1]).max() < 1e-12
    outside = motion.motion(np.array([-5.0, motion.duration + 5.0]), 4).orders
    np.testing.assert_allclose(outside[0], ends[0], atol=1e-12)
    assert not outside[1:].any()


@ALONE
def test_its_bound_holds_at_a_hundred_thousand_instants(motion) -> None:
    orders = motion.motion(np.linspace(0.0, motion.duration, 100_000), 4).orders
    for order in range(4):
        for degree in (1, 2):
            values, amplitudes, kappa = motion.bound(order, degree)
            low, high = riesz_range(values, kappa, amplitudes)
            slack = 1e-12 * np.abs(orders[order]).max()
            if degree == 1:
                assert np.all(low - slack <= orders[order].min(axis=0))
                assert np.all(orders[order].max(axis=0) <= high + slack)
            largest = (orders[order] ** 2).sum(axis=1).max()
            assert degree == 1 or largest <= (values**2).sum(axis=1).max() / kappa + slack


@EVERY
def test_its_limits_are_proved(motion) -> None:
    certificate = certify(motion, LIMITS)
    assert certificate.ok
    assert [(r.axis, r.quantity) for r in certificate.rows] == [
        (name, quantity) for name in NAMES for quantity in ("position", "velocity", "acceleration")
    ]


@EVERY
def test_samples_do_not_depend_on_the_company_they_are_asked_in(motion) -> None:
    t = np.array([3.0, 1.0, 2.0, 1.0])
    together = motion.motion(t).orders[0]
    np.testing.assert_array_equal(together[1], together[3])
    np.testing.assert_allclose(motion.motion(t[2:3]).orders[0, 0], together[2], rtol=0, atol=1e-14)


@EVERY
def test_a_file_gives_it_back_bit_for_bit(motion) -> None:
    again, t = from_json(motion.to_json()), np.linspace(0.0, motion.duration, 99)
    np.testing.assert_array_equal(again.motion(t, 4).orders, motion.motion(t, 4).orders)
    assert again.form == motion.form


@EVERY
def test_slowed_down_it_keeps_limits_and_path(motion) -> None:
    slow, t = motion.slowed(2.0), np.linspace(0.0, motion.duration, 99)
    np.testing.assert_allclose(slow.motion(2.0 * t).orders[0], motion.motion(t).orders[0], atol=1e-12)
    assert certify(slow, LIMITS).ok


@ALONE
def test_one_piece_is_itself(motion) -> None:
    ((start, label, piece),) = motion.pieces()
    assert (start, label) == (0.0, "segment")
    assert piece is motion
