"""L-BFGS-B with the limits that designs and trainings give it."""

from __future__ import annotations

import numpy as np
import pytest

from etude._runtime.scipy_parts import minimise


class Valley:
    """Rosenbrock's function, and where it was asked."""

    def __init__(self, size: int) -> None:
        self.points: list[np.ndarray] = []
        self.start = np.random.default_rng(size).uniform(-2.0, 2.0, size)

    def __call__(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        self.points.append(x.copy())
        step, gradient = x[1:] - x[:-1] ** 2, np.zeros_like(x)
        gradient[:-1] = -400.0 * x[:-1] * step - 2.0 * (1.0 - x[:-1])
        gradient[1:] += 200.0 * step
        return float(100.0 * step @ step + (1.0 - x[:-1]) @ (1.0 - x[:-1])), gradient


@pytest.mark.parametrize("bounded", [False, True])
def test_it_finds_the_minimum_or_the_bound_before_it(bounded: bool) -> None:
    valley = Valley(2)
    start = np.array([-1.2, 1.0])
    minimise(valley, start, steps=200, bounds=[(-2.0, 0.5), (-2.0, 2.0)] if bounded else None)
    best = min(list(valley.points), key=lambda x: valley(x)[0])
    np.testing.assert_allclose(best, [0.5, 0.25] if bounded else [1.0, 1.0], atol=1e-3)
    assert not bounded or max(x[0] for x in list(valley.points)) <= 0.5


def test_it_asks_no_more_than_it_may() -> None:
    few, steps = Valley(12), Valley(12)
    minimise(few, few.start, steps=60, evaluations=9, searched=5)
    assert 9 <= len(few.points) <= 9 + 5
    minimise(steps, steps.start, steps=1)
    assert len(steps.points) <= 21  # one line search
