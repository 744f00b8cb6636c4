"""Drag from flights: known coefficients are found, a process enters only where it predicts better."""

from __future__ import annotations

import numpy as np
import pytest
from inverse_flights import log_with, samples_of

from etude.errors import DataError
from etude.types import Samples
from etude_quadrotor.physics.drag import DragModel, train_drag


def flights(
    quadratic: float, count: int = 3, noise: float = 0.02, seed: int = 0, sign: float = 1.0
) -> Samples:
    """Flights whose lateral force is -0.5 v_x, -0.7 v_y, less a quadratic part."""
    rng = np.random.default_rng(seed)
    t = np.arange(150) / 10
    velocity = np.concatenate(
        [
            sum(np.sin(t[:, None] * rng.uniform(0.2, 1.5, 3) + rng.uniform(0, 6, 3)) for _ in range(3))
            for _ in range(count)
        ]
    )
    size = np.linalg.norm(velocity, axis=1, keepdims=True)
    force = -velocity * [0.5, 0.7, 0.0] - quadratic * size * velocity + 0.02 * rng.normal(size=velocity.shape)
    times = np.tile(t, count)
    log = log_with(times, specific_force=sign * force, rates=velocity, body_velocity=velocity)
    return samples_of(log, np.repeat(np.arange(float(count)), len(t)))


def test_linear_drag_is_found_and_kept_simple() -> None:
    model = train_drag(flights(0.0))
    np.testing.assert_allclose(model.coefficients, [0.5, 0.7, 0.0], atol=5e-3)
    velocity = np.array([[1.0, -2.0, 0.5]])
    np.testing.assert_allclose(model.predict(velocity)[0], [[-0.5, 1.4]], atol=0.03)
    np.testing.assert_allclose(model.noise, 0.02, rtol=0.3)


def test_quadratic_drag_is_learned_by_the_process() -> None:
    data, test = flights(0.2), flights(0.2, seed=9).log
    model, line = train_drag(data), train_drag(data, process=False)
    assert all(part is not None for part in model.residual)
    velocity = test["body_velocity"]
    error, straight = (
        np.abs(m.predict(velocity)[0] - test["specific_force"][:, :2]).mean() for m in (model, line)
    )
    assert error < 0.5 * straight
    far = np.full((1, 3), 50.0)
    np.testing.assert_allclose(model.predict(far)[0], -far[:, :2] * model.linear, rtol=1e-6)
    assert model.predict(far)[1].min() > 2.0 * model.predict(velocity)[1].mean()
    again = DragModel.restored(model.arrays())
    for one, other in zip(again.predict(velocity), model.predict(velocity), strict=True):
        np.testing.assert_array_equal(one, other)


def test_one_flight_gives_the_line_alone() -> None:
    model = train_drag(flights(0.2, count=1))
    assert model.residual == (None, None)
    assert DragModel.restored(model.arrays()).residual == (None, None)


def test_a_push_from_behind_is_no_drag() -> None:
    pushed = flights(0.0, sign=-1.0)
    np.testing.assert_allclose(train_drag(pushed, process=False).coefficients, 0.0, atol=1e-12)


def test_flights_without_velocity_are_refused() -> None:
    data = flights(0.0)
    with pytest.raises(DataError, match="lack their velocity"):
        train_drag(samples_of(data.log.without("body_velocity")))
