"""Drag from flights: known coefficients are found, a process enters only where it predicts better."""

import numpy as np
import pytest

from etude.errors import DataError
from etude.models.flight.dataset import FlightDataset
from etude.models.flight.drag import train_drag
from etude.trajectories.flight.states import FlightStates


def flights(quadratic, count=3, noise=0.02, seed=0):
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
    force = (
        -velocity * [0.5, 0.7, 0.0] - quadratic * size * velocity + noise * rng.normal(size=velocity.shape)
    )
    states = FlightStates(None, force, velocity, velocity, velocity)
    group = np.repeat(np.arange(count), len(t))
    return FlightDataset(states, np.zeros((len(force), 4)), group, np.tile(t, count))


def test_linear_drag_is_found_and_kept_simple():
    model = train_drag(flights(0.0))
    np.testing.assert_allclose(model.coefficients, [0.5, 0.7, 0.0], atol=5e-3)
    velocity = np.array([[1.0, -2.0, 0.5]])
    np.testing.assert_allclose(model.predict(velocity)[0], [[-0.5, 1.4]], atol=0.03)
    np.testing.assert_allclose(model.noise, 0.02, rtol=0.3)


def test_quadratic_drag_is_learned_by_the_process():
    data, test = flights(0.2), flights(0.2, seed=9)
    model, line = train_drag(data), train_drag(data, process=False)
    assert all(part is not None for part in model.residual)
    error, straight = (
        np.abs(m.predict(test.states.velocity)[0] - test.states.specific_force[:, :2]).mean()
        for m in (model, line)
    )
    assert error < 0.5 * straight
    far = np.full((1, 3), 50.0)
    np.testing.assert_allclose(model.predict(far)[0], -far[:, :2] * model.linear, rtol=1e-6)
    assert model.predict(far)[1].min() > 2.0 * model.predict(test.states.velocity)[1].mean()


def test_one_flight_gives_the_line_alone():
    assert train_drag(flights(0.2, count=1)).residual == (None, None)


def test_a_push_from_behind_is_no_drag():
    data = flights(0.0)
    data.states.specific_force[:] *= -1.0
    np.testing.assert_allclose(train_drag(data, process=False).coefficients, 0.0, atol=1e-12)


def test_flights_without_velocity_are_refused():
    data = flights(0.0)
    bare = FlightStates(None, data.states.specific_force, data.states.rates, data.states.rates)
    with pytest.raises(DataError, match="do not say their velocity"):
        train_drag(FlightDataset(bare, data.command, data.group, data.t))
