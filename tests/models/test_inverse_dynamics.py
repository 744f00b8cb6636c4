"""The inverse dynamics model: it learns, hears the mask, and units and the order of telling do not matter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from etude.models.calibration import score
from etude.models.dataset import Dataset, concatenate
from etude.models.inverse_dynamics import InverseDynamicsModel, train_model
from etude.models.model_config import ModelConfig
from etude.models.selection import in_order, spread_points
from learning_examples import NOISE, SMALL, pendulum, trajectories, trajectory

from etude.errors import DataError, UsageError


def train(data: Dataset, config: ModelConfig = SMALL, spec=None) -> InverseDynamicsModel:
    return train_model(data, spec or pendulum(), config, np.random.default_rng(0))


def predict(model: InverseDynamicsModel, new: Dataset) -> tuple[np.ndarray, np.ndarray]:
    return model.predict(new.q, new.qd, new.qdd)


@pytest.fixture(scope="module")
def data() -> Dataset:
    return trajectories(3)


@pytest.fixture(scope="module")
def model(data: Dataset) -> InverseDynamicsModel:
    return train(data)


def test_a_new_motion_is_predicted_with_honest_variances(model) -> None:
    new = trajectory(9)
    result = score(new.tau, *predict(model, new), ~new.stuck)
    assert np.all(result.nmse < 0.1)
    assert np.all((result.z2 > 0.3) & (result.z2 < 2.5))
    assert np.all(result.coverage > 0.85)


@pytest.mark.parametrize("kind", ["identified", "identified+gp"])
def test_physics_helps_and_the_process_learns_what_it_lacks(kind, data, model, tmp_path) -> None:
    new = trajectory(9)
    learned = train(data, replace(SMALL, kind=kind), pendulum(tmp_path))
    mean, variance = predict(learned, new)
    error = float(np.mean((mean - new.tau)[~new.stuck] ** 2))
    ripple = 0.5**2 / 2 + NOISE**2
    assert learned.fallback is not None
    assert np.all(variance > 0)
    assert error < (2.0 * ripple if kind == "identified" else ripple)


def test_variances_are_of_the_measured_command_and_inflated(model) -> None:
    new = trajectory(9)
    X = model.features.transform(new.q, new.qd, new.qdd)
    _, variance = predict(replace(model, scale=np.array([1.0, 4.0])), new)
    for j, factor in enumerate((1.0, 4.0)):
        posterior = model.posteriors[j]
        expected = factor * (posterior.predict(X)[1] + posterior.noise_variance)
        np.testing.assert_allclose(variance[:, j], expected, rtol=1e-12)
    assert np.all(model.scale >= 1.0)


def test_what_the_mask_hides_changes_nothing(data, model, tmp_path) -> None:
    assert np.all(data.stuck.any(axis=0))
    spoiled = replace(data, tau=np.where(data.stuck, 50.0, data.tau))
    new = trajectory(9)
    for kind, reference in (("gp", model), ("identified+gp", None)):
        config, spec = replace(SMALL, kind=kind), pendulum(tmp_path)
        reference = reference or train(data, config, spec)
        np.testing.assert_array_equal(
            predict(train(spoiled, config, spec), new)[0], predict(reference, new)[0]
        )


def test_the_unit_of_the_command_does_not_matter(data, model) -> None:
    spec = pendulum()
    scaled_spec = replace(spec, axes=tuple(replace(axis, command=1000 * axis.command) for axis in spec.axes))
    scaled = train(replace(data, tau=1000 * data.tau), spec=scaled_spec)
    new = trajectory(9)
    mean, variance = predict(model, new)
    scaled_mean, scaled_variance = predict(scaled, new)
    np.testing.assert_allclose(scaled_mean / 1000, mean, rtol=1e-3, atol=1e-2)
    np.testing.assert_allclose(scaled_variance / 1e6, variance, rtol=2e-2)


def test_order_of_telling_and_telling_twice_change_nothing(data, model) -> None:
    parts = [data.take(data.group == number) for number in (2, 0, 1)]
    twice = replace(parts[0], group=np.full(len(parts[0]), 5))
    new = trajectory(9)
    for told in (concatenate(parts), concatenate([*parts, parts[1]]), concatenate([*parts, twice])):
        np.testing.assert_array_equal(predict(train(told), new)[0], predict(model, new)[0])


def test_the_prior_deviation_is_that_of_a_model_without_data(model) -> None:
    far = np.full((1, 2), 60.0)
    at = np.hstack([far, far * 0, far * 0, np.zeros((1, 6))])
    for posterior, deviation in zip(model.posteriors, model.prior_deviation, strict=True):
        prior = float(posterior.kernel.diagonal(posterior.theta, at)[0]) + posterior.noise_variance
        assert posterior.predict(at)[1][0] + posterior.noise_variance == pytest.approx(prior, rel=1e-6)
        assert prior <= deviation**2 * (1 + 1e-9)


def test_a_warm_start_of_no_steps_keeps_the_hyperparameters(data, model) -> None:
    again = train_model(
        trajectories(4), pendulum(), replace(SMALL, steps=0), np.random.default_rng(0), previous=model
    )
    for old, new in zip(model.posteriors, again.posteriors, strict=True):
        np.testing.assert_array_equal(new.theta, old.theta)
        assert new.noise_variance == pytest.approx(old.noise_variance, rel=1e-3)


def test_points_are_spread_apart_and_over_all_trajectories(data) -> None:
    rng = np.random.default_rng(0)
    use = ~data.stuck[:, 0]
    index = spread_points(data, use, 30, 1.0, rng)
    assert len(index) <= 30
    assert np.all(use[index])
    assert set(data.group[index]) == {0, 1, 2}
    index = spread_points(data, use, 10**6, 1.0, rng)
    same = np.diff(data.group[index]) == 0
    assert np.all(np.diff(data.t[index])[same] >= 1.0 - 1e-9)
    assert len(spread_points(data, use, 10**6, 0.0, rng)) == np.count_nonzero(use)


def test_in_order_sorts_and_drops_repetitions(data) -> None:
    shuffled = data.take(np.random.default_rng(1).permutation(np.tile(np.arange(len(data)), 2)))
    restored = in_order(shuffled)
    for name in data.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(restored, name), getattr(data, name))


def test_what_cannot_be_trained_is_refused(data) -> None:
    with pytest.raises(UsageError, match="no model_file"):
        train(data, replace(SMALL, kind="identified"))
    with pytest.raises(UsageError, match="One model has one kind"):
        train(data, replace(SMALL, kind="auto"))
    with pytest.raises(DataError, match="hardly moves"):
        train(replace(data, stuck=np.ones_like(data.stuck)))
    with pytest.raises(UsageError, match="2 axes, the robot pendulum has 1"):
        train(data, spec=replace(pendulum(), axes=pendulum().axes[:1]))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "magic"}, "kind must be one of"),
        ({"kernel": "rbf"}, "kernel must be one of"),
        ({"points": 1}, "points must be at least 2"),
        ({"noise_floor": -1.0}, "noise_floor must be a number >= 0"),
        ({"friction_fraction": 0.0}, "needs the friction feature"),
    ],
)
def test_impossible_configurations_are_refused(change, message) -> None:
    with pytest.raises(UsageError, match=message):
        replace(SMALL, **change)
