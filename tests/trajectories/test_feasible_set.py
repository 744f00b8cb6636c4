from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from etude.trajectories.flight.feasible_set import Cone, FeasibleSet
from etude.trajectories.flight.samplers import uniform_parameters

NO_SLABS = np.zeros((0, 3))


def box(half: np.ndarray, middle: np.ndarray) -> FeasibleSet:
    return FeasibleSet(np.diag(1.0 / half), middle / half, (), middle)


def ball(size: int, radius: float = 1.0) -> FeasibleSet:
    cone = Cone("ball", np.eye(size)[:, None, :] / radius, np.zeros((size, 1)), np.zeros((1, size)))
    return FeasibleSet(np.zeros((0, size)), np.zeros(0), (cone,), np.zeros(size))


def frustum() -> FeasibleSet:
    """|(x, y)| <= 1 + z, |z| <= 1/2: a cone with its tip cut off."""
    rows = np.eye(3)[:2, None, :]
    cone = Cone("cone", rows, np.zeros((2, 1)), np.array([[0.0, 0.0, 1.0]]))
    return FeasibleSet(np.array([[0.0, 0.0, 2.0]]), np.zeros(1), (cone,), np.zeros(3))


def p_value(values: np.ndarray, cdf) -> float:
    return float(stats.kstest(values, cdf).pvalue)


def test_hit_and_run_is_uniform_on_a_box() -> None:
    half, middle = np.array([1.0, 20.0, 0.1]), np.array([0.0, 5.0, -1.0])
    points = (uniform_parameters(np.random.default_rng(0), box(half, middle), 2000, 100) - middle) / half
    for column in points.T:
        assert p_value(column, stats.uniform(-1.0, 2.0).cdf) > 1e-3
    assert np.abs(np.corrcoef(points.T) - np.eye(3)).max() < 0.08


@pytest.mark.parametrize("size", [2, 5])
def test_hit_and_run_is_uniform_on_a_ball(size: int) -> None:
    points = uniform_parameters(np.random.default_rng(1), ball(size, 3.0), 2000, 100) / 3.0
    radius = np.linalg.norm(points, axis=1)
    assert p_value(radius**size, stats.uniform.cdf) > 1e-3
    assert p_value(points[:, 0], lambda x: stats.beta((size + 1) / 2, (size + 1) / 2).cdf((x + 1) / 2)) > 1e-3


def test_hit_and_run_is_uniform_on_a_cone() -> None:
    points = uniform_parameters(np.random.default_rng(2), frustum(), 2000, 100)
    assert p_value(points[:, 2], lambda z: ((1 + z) ** 3 - 0.5**3) / (1.5**3 - 0.5**3)) > 1e-3
    share = np.linalg.norm(points[:, :2], axis=1) / (1.0 + points[:, 2])
    assert p_value(share**2, stats.uniform.cdf) > 1e-3


def test_a_walk_too_short_is_not_uniform() -> None:
    """The test above has power."""
    points = uniform_parameters(np.random.default_rng(1), ball(5), 2000, 2)
    assert p_value(np.linalg.norm(points, axis=1) ** 5, stats.uniform.cdf) < 1e-6


@pytest.mark.parametrize("feasible", [ball(3, 2.0), frustum(), box(np.array([1.0, 2.0, 0.5]), np.ones(3))])
def test_ends_of_lines_are_exact(feasible: FeasibleSet) -> None:
    rng = np.random.default_rng(3)
    points = uniform_parameters(rng, feasible, 50, 20)
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


def test_slack_and_its_derivative() -> None:
    rng = np.random.default_rng(4)
    rows, offset = rng.standard_normal((3, 7, 4)), 0.1 * rng.standard_normal((3, 7))
    cone = Cone("any", rows, offset, 0.2 * rng.standard_normal((7, 4)))
    feasible = FeasibleSet(rng.standard_normal((5, 4)), 0.1 * rng.standard_normal(5), (cone,), np.zeros(4))
    point = rng.standard_normal(4)
    assert feasible.contains(np.zeros(4)) == bool(np.all(feasible.slack(np.zeros(4)) >= 0.0))
    numeric = [(feasible.slack(point + d) - feasible.slack(point - d)) / 2e-6 for d in 1e-6 * np.eye(4)]
    np.testing.assert_allclose(feasible.slack_jacobian(point), np.transpose(numeric), atol=1e-7)


def test_the_other_nappe_of_a_cone_is_outside() -> None:
    assert not frustum().contains(np.array([0.0, 0.0, -2.0]))
    cone = frustum().cones[0]
    alone = FeasibleSet(NO_SLABS, np.zeros(0), (cone,), np.zeros(3))
    assert not alone.contains(np.array([0.0, 0.0, -3.0]))


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
