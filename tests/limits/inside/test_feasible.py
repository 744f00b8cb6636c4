from __future__ import annotations

import numpy as np
import pytest
from limit_examples import ARM_CONFIGS, arm, feasible_arm, flights, middle, room

from etude.errors import UnsafeTrajectoryError
from etude.limits import AxisLimit, FeasibleSet, NormLimit, boundary, certify, require_certified, uniform
from etude.limits.feasible import check_room, still_at
from etude.trajectories import FourierConfig, FourierFamily

EVERY_ARM = pytest.mark.parametrize("config", ARM_CONFIGS.values(), ids=ARM_CONFIGS.keys())


def test_joints_are_blocks_of_their_own_and_a_speed_couples_its_axes() -> None:
    limits, config = arm(3, 4), FourierConfig(3, 20.0)
    family, feasible = feasible_arm(limits, config)
    assert [list(block.members) for block in feasible.blocks] == [
        [j * 5 + i for i in range(5)] for j in range(4)
    ]
    np.testing.assert_array_equal(feasible.block_of, np.repeat(np.arange(4), 5))
    pair = NormLimit("speed of two", 1, (1, 3), 0.5)
    coupled = FeasibleSet.of((*limits, pair), family, middle(limits))
    # constant terms have no speed: only the limits of position and the others couple them with their axis
    assert [len(block.members) for block in coupled.blocks] == [5, 10, 5]
    assert list(coupled.blocks[1].members) == [*range(5, 10), *range(15, 20)]


@EVERY_ARM
def test_the_centre_stands_still_at_home(config) -> None:
    limits = arm(1)
    family, feasible = feasible_arm(limits, config)
    motion = family.motion(feasible.centre, np.linspace(0.0, family.duration, 9)).orders
    np.testing.assert_allclose(motion[0] - middle(limits), 0.0, atol=1e-14)
    np.testing.assert_allclose(motion[1:], 0.0, atol=1e-13)
    assert not feasible.gauge(feasible.centre).any()


@EVERY_ARM
def test_scaled_back_is_certified_and_touches_a_limit(config) -> None:
    rng = np.random.default_rng(5)
    for seed in range(10):
        limits = arm(seed)
        family, feasible = feasible_arm(limits, config, seed)
        step = rng.standard_normal(family.size) * 10.0 ** rng.uniform(-1, 2, 3)[feasible.block_of]
        wild = feasible.centre + step
        tame, full = feasible.shrink(wild), feasible.enlarge(wild)
        for p in (tame, full):
            assert feasible.contains(p)
            assert certify(family.trajectory(p), limits).ok
        use = feasible.gauge(wild)
        np.testing.assert_allclose(feasible.gauge(tame), np.minimum(use, 1.0), atol=1e-8)
        np.testing.assert_allclose(feasible.gauge(full), 1.0, atol=1e-8)
        inside = (use <= 1.0)[feasible.block_of]
        np.testing.assert_array_equal(tame[inside], wild[inside])


@EVERY_ARM
def test_the_smooth_gauge_is_a_close_upper_bound(config) -> None:
    rng = np.random.default_rng(8)
    family, feasible = feasible_arm(arm(5), config)
    for _ in range(30):
        p = feasible.centre + rng.standard_normal(family.size) * 10.0 ** rng.uniform(-2, 3)
        values, gradient = feasible.smooth_gauge(p)
        ratio = values / feasible.gauge(p)
        assert 1.0 <= ratio.min() <= ratio.max() < 1.2
        shift = rng.standard_normal(family.size)
        h = 1e-6 * np.abs(p - feasible.centre).max()
        ahead, behind = (feasible.smooth_gauge(p + s * h * shift)[0] for s in (1.0, -1.0))
        slope = np.bincount(feasible.block_of, gradient * shift)
        np.testing.assert_allclose((ahead - behind) / (2 * h), slope, rtol=1e-4, atol=1e-6)


def test_the_set_is_convex() -> None:
    rng = np.random.default_rng(7)
    for limits in (room(speed=5.0, radius=9.0, tilt=0.3, thrust=(7.0, 11.0)), arm(3)):
        family = flights(3, 1.3) if len(limits) > 3 else FourierFamily.of(FourierConfig(), 3)
        feasible = FeasibleSet.of(limits, family, middle(limits))
        points = boundary(rng, feasible, 10)
        for one, other in zip(points[:5], points[5:], strict=True):
            assert feasible.contains(rng.uniform() * (one - other) + other)


def test_widths_are_those_of_the_whole_set() -> None:
    limits = arm(3)
    _, feasible = feasible_arm(limits, ARM_CONFIGS["null space"])
    widths = feasible.widths()
    for i in (0, 5, 20):
        step = np.eye(feasible.size)[i]
        assert feasible.contains(feasible.centre + 0.999999 * widths[i] * step)
        assert not feasible.contains(feasible.centre + 1.000001 * widths[i] * step)


def test_room_in_a_cylinder_off_the_middle_of_its_box() -> None:
    limits = room((0.0, -5.0, 0.0), (10.0, 5.0, 5.0), radius=3.0)
    with pytest.raises(UnsafeTrajectoryError, match=r"about 5, 0, 2\.5 have no room .* vehicle, radius"):
        FeasibleSet.of(limits, flights(centre=(5.0, 0.0)), np.array([5.0, 0.0, 2.5]))
    family = flights(free=True)
    feasible = FeasibleSet.of(limits, family, np.array([1.5, 0.0, 2.5]))
    require_certified(family.trajectory(uniform(np.random.default_rng(0), feasible)[0]), limits)


def test_a_family_fixed_elsewhere_is_centred_where_it_can_be() -> None:
    family = flights(centre=(1.0, -2.0))
    centre = still_at(family, np.array([0.0, 0.0, 2.0]))
    np.testing.assert_allclose(family.coefficients(centre)[0], [1.0, -2.0, 2.0], atol=1e-14)
    with pytest.raises(UnsafeTrajectoryError, match=r"about 9\.8, 0, 2\.65 have no room") as caught:
        FeasibleSet.of(room(), flights(centre=(9.8, 0.0)), middle(room()))
    assert caught.value.where == "x, position"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"margin": 2.4}, r"position limit 0\.3\.\.5 less 2\.4 on both sides of 'z' leaves no room"),
        ({"lower": (-10.0, 12.0, 0.3)}, "of 'y' leaves no room"),
        ({"lower": (-10.0, float("nan"), 0.3)}, "of 'y' leaves no room"),
        ({"radius": 0.5}, r"radius limit 0\.5 less 0\.5 of 'vehicle' leaves no room"),
        ({"speed": 0.0}, "speed limit 0 of 'vehicle' leaves no room"),
        ({"speed": -1.0}, "speed limit -1"),
        ({"speed": float("nan")}, "speed limit nan"),
        ({"tilt": 0.0}, "tilt limit 0 rad"),
        ({"tilt": 1.6}, "tilt limit 1.6 rad"),
        ({"thrust": (10.0, 12.0)}, r"leaves no room"),
        ({"thrust": (5.0, 9.0)}, r"thrust limit 5\.\.9, 9\.81 at rest included of"),
        ({"margin": -0.1}, "leaves no room"),
    ],
)
def test_limits_that_no_flight_meets(changes, message: str) -> None:
    limits = room(**changes)
    with pytest.raises(UnsafeTrajectoryError, match=message) as caught:
        check_room(limits, flights())
    assert caught.value.exit_code == 4
    with pytest.raises(UnsafeTrajectoryError, match="no room"):
        FeasibleSet.of(limits, flights(), np.array([0.0, 0.0, 2.65]))


@pytest.mark.parametrize(
    ("order", "lower", "upper", "message"),
    [
        (0, 0.2, 0.2, r"0\.2\.\.0\.2 of 'j1'"),
        (0, 0.2, 0.1, r"0\.2\.\.0\.1 of 'j1'"),
        (1, 0.0, 0.0, "velocity limit 0 of 'j1'"),
        (2, float("nan"), float("nan"), "acceleration limit .* of 'j1'"),
    ],
)
def test_axis_limits_without_room(order: int, lower: float, upper: float, message: str) -> None:
    limits = list(arm())
    old = limits[order]
    low, high = np.array(old.lower), np.array(old.upper)
    low[1], high[1] = lower, upper
    limits[order] = AxisLimit(old.quantity, order, old.names, low, high)
    with pytest.raises(UnsafeTrajectoryError, match=f"{message} leaves no room for motion"):
        FeasibleSet.of(limits, FourierFamily.of(FourierConfig(), 3), middle(arm()))


def test_a_parameter_that_nothing_bounds() -> None:
    limits = (AxisLimit("velocity", 1, ("a",), -np.ones(1), np.ones(1)),)
    with pytest.raises(UnsafeTrajectoryError, match="no limit bounds parameter 0"):
        FeasibleSet.of(limits, FourierFamily.of(FourierConfig(), 1), np.zeros(1))


def test_limits_that_are_infinite_have_no_cones() -> None:
    wide = AxisLimit("position", 0, ("a", "b"), np.array([-np.inf, -1.0]), np.array([np.inf, 1.0]))
    cones = wide.cones(FourierFamily.of(FourierConfig(), 2))
    assert [cone.name for cone in cones] == ["b, position"]
