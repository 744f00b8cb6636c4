from __future__ import annotations

import numpy as np
import pytest
from trajectory_examples import FAMILIES, robot

from etude.trajectories.certificate import certify
from etude.trajectories.gauge import certified_rows

EVERY = pytest.mark.parametrize("family", FAMILIES.values(), ids=FAMILIES.keys())


@EVERY
def test_scaled_back_is_certified_and_touches_a_limit(family) -> None:
    rng = np.random.default_rng(5)
    for seed in range(20):
        spec = robot(seed)
        rows, omega0 = certified_rows(spec, family), family.draw_omega0(rng)
        free = family.free_basis
        wild = free @ rng.standard_normal((free.shape[1], 3)) * 10.0 ** rng.uniform(-1, 2, 3) + rows.centre(
            family.harmonics
        )
        tame, full = rows.scale_to(wild, omega0), rows.scale_to(wild, omega0, enlarge=True)
        for table in (tame, full):
            assert certify(family.trajectory(table, omega0), spec).ok
        use = rows.gauge(wild, omega0)
        np.testing.assert_allclose(rows.gauge(tame, omega0), np.minimum(use, 1.0), atol=1e-9)
        np.testing.assert_allclose(rows.gauge(full, omega0), 1.0, atol=1e-9)
        np.testing.assert_array_equal(tame[:, use <= 1.0], wild[:, use <= 1.0])


@EVERY
def test_the_smooth_gauge_is_a_close_upper_bound(family) -> None:
    rng, spec = np.random.default_rng(8), robot(5)
    rows, omega0 = certified_rows(spec, family), family.draw_omega0(rng)
    for _ in range(50):
        table = rng.standard_normal((2 * family.harmonics + 1, 3)) * 10.0 ** rng.uniform(-2, 3)
        ratio = rows.smooth_gauge(table, omega0)[0] / rows.gauge(table, omega0)
        assert 1.0 <= ratio.min() <= ratio.max() < 1.2


@EVERY
def test_gradient_of_the_smooth_gauge(family) -> None:
    rng, spec = np.random.default_rng(6), robot(2)
    rows, omega0 = certified_rows(spec, family), family.draw_omega0(rng)
    table = rng.standard_normal((2 * family.harmonics + 1, 3))
    use, gradient, slope = rows.smooth_gauge(table, omega0)
    for index in np.ndindex(table.shape):
        shift = np.zeros_like(table)
        shift[index] = 1e-5
        difference = (
            rows.smooth_gauge(table + shift, omega0)[0] - rows.smooth_gauge(table - shift, omega0)[0]
        ) / 2e-5
        assert difference[index[1]] == pytest.approx(gradient[index], rel=1e-5, abs=1e-6 * use.max())
    h = 1e-6
    difference = (rows.smooth_gauge(table, omega0 + h)[0] - rows.smooth_gauge(table, omega0 - h)[0]) / (2 * h)
    np.testing.assert_allclose(difference, slope, rtol=1e-5, atol=1e-6 * use.max())


@EVERY
def test_the_set_inside_the_gauge_is_convex(family) -> None:
    rng, spec = np.random.default_rng(7), robot(3)
    rows, omega0 = certified_rows(spec, family), family.draw_omega0(rng)
    shape = (2 * family.harmonics + 1, 3)
    for _ in range(20):
        one, two = (rows.scale_to(rng.standard_normal(shape), omega0) for _ in range(2))
        assert rows.gauge(0.3 * one + 0.7 * two, omega0).max() <= 1.0 + 1e-12
