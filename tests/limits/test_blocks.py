from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from etude.limits import Block, FeasibleSet, uniform
from etude.types import Cone


def alone(cones: list[Cone], centre: np.ndarray) -> FeasibleSet:
    """A set of one block."""
    return FeasibleSet((Block.of(np.arange(len(centre)), cones, centre),), centre)


def slab(rows: np.ndarray, middle: np.ndarray) -> Cone:
    return Cone("slabs", rows[None], -middle[None])


def box(half: np.ndarray, middle: np.ndarray) -> FeasibleSet:
    return alone([slab(np.diag(1.0 / half), middle / half)], middle)


def ball(size: int, radius: float = 1.0) -> FeasibleSet:
    return alone([Cone("ball", np.eye(size)[:, None, :] / radius, np.zeros((size, 1)))], np.zeros(size))


def nappe() -> Cone:
    """|(x, y)| <= 1 + z."""
    return Cone("cone", np.eye(3)[:2, None, :], np.zeros((2, 1)), np.array([[0.0, 0.0, 1.0]]))


def frustum() -> FeasibleSet:
    """The cone with its tip cut off: |z| <= 1/2."""
    return alone([nappe(), slab(np.array([[0.0, 0.0, 2.0]]), np.zeros(1))], np.zeros(3))


def lopsided() -> FeasibleSet:
    """Ball, cone and slabs seen from a point that is the middle of none."""
    rng = np.random.default_rng(8)
    slope = 0.1 * rng.standard_normal((7, 4))
    cones = [
        Cone("ball", 0.4 * rng.standard_normal((3, 6, 4)), 0.2 * rng.standard_normal((3, 6))),
        Cone("cone", 0.4 * rng.standard_normal((2, 7, 4)), 0.2 * rng.standard_normal((2, 7)), slope),
        slab(0.6 * rng.standard_normal((9, 4)), 0.3 * rng.standard_normal(9)),
    ]
    return alone(cones, 0.1 * rng.standard_normal(4))


def p_value(values: np.ndarray, cdf) -> float:
    return float(stats.kstest(values, cdf).pvalue)


def test_hit_and_run_is_uniform_on_a_box() -> None:
    half, middle = np.array([1.0, 20.0, 0.1]), np.array([0.0, 5.0, -1.0])
    points = (uniform(np.random.default_rng(0), box(half, middle), 2000, 100) - middle) / half
    for column in points.T:
        assert p_value(column, stats.uniform(-1.0, 2.0).cdf) > 1e-3
    assert np.abs(np.corrcoef(points.T) - np.eye(3)).max() < 0.08


@pytest.mark.parametrize("size", [2, 5])
def test_hit_and_run_is_uniform_on_a_ball(size: int) -> None:
    points = uniform(np.random.default_rng(1), ball(size, 3.0), 2000, 100) / 3.0
    radius = np.linalg.norm(points, axis=1)
    assert p_value(radius**size, stats.uniform.cdf) > 1e-3
    assert p_value(points[:, 0], lambda x: stats.beta((size + 1) / 2, (size + 1) / 2).cdf((x + 1) / 2)) > 1e-3


def test_hit_and_run_is_uniform_on_a_cone() -> None:
    points = uniform(np.random.default_rng(2), frustum(), 2000, 100)
    assert p_value(points[:, 2], lambda z: ((1 + z) ** 3 - 0.5**3) / (1.5**3 - 0.5**3)) > 1e-3
    share = np.linalg.norm(points[:, :2], axis=1) / (1.0 + points[:, 2])
    assert p_value(share**2, stats.uniform.cdf) > 1e-3


def test_a_walk_too_short_is_not_uniform() -> None:
    """The test above has power."""
    points = uniform(np.random.default_rng(1), ball(5), 2000, 2)
    assert p_value(np.linalg.norm(points, axis=1) ** 5, stats.uniform.cdf) < 1e-6


@pytest.mark.parametrize("feasible", [ball(3, 2.0), frustum(), box(np.array([1.0, 2.0, 0.5]), np.ones(3))])
def test_ends_of_lines_are_exact(feasible: FeasibleSet) -> None:
    rng = np.random.default_rng(3)
    points = uniform(rng, feasible, 50, 20)
    directions = rng.standard_normal((50, 3)) * 10.0 ** rng.uniform(-3, 3, (50, 1))
    low, high = feasible.chord(points, directions)
    for point, direction, first, last in zip(points, directions, low, high, strict=True):
        assert first < 0.0 < last
        for end in (first, last):
            assert feasible.contains(point + 0.999999 * end * direction)
            assert not feasible.contains(point + 1.000001 * end * direction)


def test_along_an_axis_of_the_frustum() -> None:
    """Lines that keep within the cone upwards end at a slab; along its wall they run on."""
    feasible = frustum()
    lines = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [1.0, 0.0, -1.0]])
    low, high = feasible.chord(np.zeros((4, 3)), lines)
    np.testing.assert_allclose(high, [0.5, 1.0, 0.5, 0.5])
    np.testing.assert_allclose(low, [-0.5, -1.0, -0.5, -0.5])


def test_the_gauge_is_how_far_the_edge_is_away() -> None:
    rng = np.random.default_rng(4)
    for feasible in (ball(3, 2.0), frustum(), lopsided(), box(np.array([1.0, 2.0]), np.array([3.0, -1.0]))):
        steps = rng.standard_normal((40, feasible.size)) * 10.0 ** rng.uniform(-3, 3, (40, 1))
        ends = feasible.chord(np.tile(feasible.centre, (40, 1)), steps)[1]
        for step, end in zip(steps, ends, strict=True):
            assert feasible.gauge(feasible.centre + step)[0] == pytest.approx(1.0 / end, rel=1e-12)
        assert feasible.gauge(feasible.centre)[0] == 0.0


def test_the_smooth_gauge_is_a_close_upper_bound_with_its_gradient() -> None:
    rng = np.random.default_rng(5)
    for feasible in (ball(3, 2.0), frustum(), lopsided()):
        for step in rng.standard_normal((20, feasible.size)) * 10.0 ** rng.uniform(-2, 3, (20, 1)):
            p = feasible.centre + step
            values, gradient = feasible.smooth_gauge(p)
            assert 1.0 <= values[0] / feasible.gauge(p)[0] < 1.1
            h = 1e-6 * np.linalg.norm(step)
            shifts = h * np.eye(feasible.size)
            numeric = [
                (feasible.smooth_gauge(p + d)[0][0] - feasible.smooth_gauge(p - d)[0][0]) / (2 * h)
                for d in shifts
            ]
            np.testing.assert_allclose(gradient, numeric, atol=1e-6 * np.abs(gradient).max())
        values, gradient = feasible.smooth_gauge(feasible.centre)  # where a search may begin
        assert 0.0 <= values[0] < 1e-300
        assert not gradient.any()


def test_a_direction_that_runs_away_inside_a_cone_uses_nothing() -> None:
    along = alone([nappe()], np.zeros(3))
    assert along.gauge(np.array([0.0, 0.0, 5.0]))[0] == 0.0
    assert along.gauge(np.array([0.0, 0.0, -5.0]))[0] == pytest.approx(5.0)


def test_the_other_nappe_of_a_cone_is_outside() -> None:
    assert not frustum().contains(np.array([0.0, 0.0, -2.0]))
    assert not alone([nappe()], np.zeros(3)).contains(np.array([0.0, 0.0, -3.0]))


def test_the_ellipsoid_holds_the_set_and_has_its_proportions() -> None:
    rng = np.random.default_rng(6)
    for feasible in (ball(3, 2.0), box(np.array([1.0, 20.0, 0.1]), np.zeros(3))):
        shape = feasible.ellipsoid()
        inside = np.linalg.solve(shape, (uniform(rng, feasible, 200, 30) - feasible.centre).T)
        sizes = np.linalg.norm(inside, axis=0)
        assert sizes.max() <= 1.0 + 1e-12
        assert sizes.max() > 0.4


def test_shrink_goes_straight_to_the_edge() -> None:
    feasible = ball(3, 2.0)
    inside = np.array([0.5, 0.5, 1.0])
    np.testing.assert_array_equal(feasible.shrink(inside), inside)
    moved = feasible.shrink(10.0 * inside)
    np.testing.assert_allclose(moved / np.linalg.norm(moved), inside / np.linalg.norm(inside))
    assert np.linalg.norm(moved) == pytest.approx(2.0, rel=1e-6)
    assert feasible.contains(moved)


def test_widths() -> None:
    np.testing.assert_allclose(box(np.array([1.0, 2.0, 0.5]), np.ones(3)).widths(), [1.0, 2.0, 0.5])
