"""Local Gaussian processes: exact where one holds all, blended by the formulas of the paper, bad input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arm_kernel import structured_kernel
from hypothesis import given, settings
from hypothesis import strategies as st

from etude.errors import DataError, UsageError
from etude.models import (
    ExactGP,
    Linear,
    SquaredExponential,
    posterior_arrays,
    posterior_metadata,
    posterior_of,
)
from etude_sparse import LocalGP
from etude_sparse.local import OVERFLOW, fitting_reach, kernel_lengths, partition

D = 3
GP = ExactGP(SquaredExponential(tuple(range(D))), np.log([1.2, 0.7, 0.9, 0.8]), np.log(0.2), 0.1)
LOCAL = LocalGP(GP, capacity=40, generate=0.2, nearest=3, lengths=0.6 * np.ones(D))


def data(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    X = rng.uniform(-2.0, 2.0, size=(n, D))
    return X, np.sin(2.0 * X[:, 0]) + X[:, 1] * X[:, 2] + 0.1 * rng.normal(size=n)


def test_one_local_model_of_all_samples_is_exact_regression() -> None:
    (X, y), (Z, _) = data(50), data(20, 1)
    one, full = LocalGP(GP, capacity=50).condition(X, y), GP.condition(X, y)
    assert len(one.models) == 1
    g = np.linspace(-1.0, 2.0, 20)
    for ours, theirs in zip(one.predict(Z), full.predict(Z), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(one.mean(Z), full.mean(Z), atol=1e-9)
    np.testing.assert_allclose(one.mean_gradient(Z), full.mean_gradient(Z), atol=1e-9)
    np.testing.assert_allclose(one.variance_gradient(Z, g), full.variance_gradient(Z, g), atol=1e-9)
    online = LocalGP(GP, capacity=50, lengths=1e3 * np.ones(D)).begin()
    for x, target in zip(X, y, strict=True):
        assert online.observe(x, target) == 0
    for model in (online, online.posterior()):
        for ours, theirs in zip(model.predict(Z), full.predict(Z), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-11)


def test_the_blend_is_that_of_the_formulas() -> None:
    (X, y), (Z, _) = data(150), data(12, 1)
    posterior = LOCAL.condition(X, y)
    assert len(posterior.models) > 10
    mean, variance = posterior.predict(Z)
    for z, m, v in zip(Z, mean, variance, strict=True):
        w = np.exp(-0.5 * np.sum(((z - posterior.centres) / 0.6) ** 2, axis=1))
        near = np.argsort(-w)[:3]
        parts = [posterior.models[k].predict(z[None]) for k in near]
        mu, s2 = (np.array([part[i][0] for part in parts]) for i in (0, 1))
        assert m == pytest.approx(w[near] @ mu / w[near].sum(), rel=1e-9)
        assert v == pytest.approx(w[near].sum() / (w[near] @ (1.0 / s2)), rel=1e-9)
    np.testing.assert_allclose(posterior.mean(Z), mean, rtol=1e-12)


def test_learning_one_by_one_is_learning_at_once_full_models_included() -> None:
    (X, y), (Z, _) = data(300), data(15, 1)
    local = replace(LOCAL, capacity=12)
    online, batch = local.begin(), local.condition(X, y)
    for x, target in zip(X, y, strict=True):
        online.observe(x, target)
    assert online.samples == online.counts.sum() == 300
    assert online.counts.max() > 12 == batch.counts.max()
    np.testing.assert_allclose(online.centres, batch.centres, atol=1e-12)
    for model in (online, online.posterior()):
        for ours, theirs in zip(model.predict(Z), batch.predict(Z), strict=True):
            np.testing.assert_allclose(ours, theirs, atol=1e-8)


def test_samples_join_what_they_activate_most_or_begin_anew() -> None:
    X, _ = data(200)
    own = partition(X / 0.6, LOCAL.reach)
    seen: list[list[np.ndarray]] = []
    for x, k in zip(X, own, strict=True):
        w = [np.exp(-0.5 * np.sum(((x - np.mean(part, axis=0)) / 0.6) ** 2)) for part in seen]
        if max(w, default=0.0) <= LOCAL.generate:
            assert k == len(seen)
            seen.append([])
        else:
            assert k == int(np.argmax(w))
        seen[k].append(x)


def test_a_full_model_keeps_what_the_others_determine_least() -> None:
    rng = np.random.default_rng(3)
    near, far = 0.01 * rng.normal(size=(60, D)), rng.uniform(-1.0, 1.0, size=(8, D))
    X = np.concatenate([far, near])
    posterior = replace(LOCAL, capacity=12, lengths=10.0 * np.ones(D)).condition(X, X[:, 0])
    assert len(posterior.models) == 1
    kept = {tuple(x) for x in posterior.X}
    assert all(tuple(x) in kept for x in far)


@settings(deadline=None, max_examples=15)
@given(n=st.integers(1, 120), capacity=st.integers(1, 60), seed=st.integers(0, 99))
def test_parts_fit_their_capacity(n, capacity, seed) -> None:
    U = data(n, seed)[0]
    counts = np.bincount(partition(U, fitting_reach(U, capacity)))
    assert counts.sum() == n
    assert np.maximum(counts - capacity, 0).sum() <= OVERFLOW * n
    if n <= capacity:
        assert len(counts) == 1


def test_more_room_is_nearer_to_exact() -> None:
    (X, y), (Z, truth) = data(600), data(300, 1)
    errors = [
        float(np.mean((model.condition(X, y).predict(Z)[0] - truth) ** 2))
        for model in (LocalGP(GP, capacity=20), LocalGP(GP, capacity=100), GP)
    ]
    assert errors[0] > errors[1] > errors[2]
    assert errors[0] < 0.25 * np.var(truth)


def test_lengths_are_those_of_the_part_that_sees_every_input() -> None:
    kernel = structured_kernel(2, 0)
    theta = np.arange(kernel.size, dtype=float) / 10.0
    np.testing.assert_array_equal(kernel_lengths(kernel, theta), np.exp(theta[-8:]))
    swapped = SquaredExponential((2, 0, 1))
    np.testing.assert_allclose(kernel_lengths(swapped, np.log([5.0, 1.0, 2.0, 3.0])), [2.0, 3.0, 1.0])
    with pytest.raises(UsageError, match="no squared exponential of all inputs"):
        kernel_lengths(SquaredExponential((0,)) + Linear((0, 1)), np.zeros(4))


def test_far_away_the_prior_returns_and_a_large_scale_changes_nothing() -> None:
    X, y = data(120)
    posterior = LOCAL.condition(X, y)
    mean, variance = posterior.predict(1e6 * np.ones((1, D)))
    assert mean[0] == pytest.approx(0.0, abs=1e-12)
    assert variance[0] == pytest.approx(1.2**2)
    large = ExactGP(GP.kernel, GP.theta + np.log([1.0, 1e6, 1e6, 1e6]), GP.log_noise, 0.1)
    scaled = replace(LOCAL, gp=large, lengths=6e5 * np.ones(D)).condition(1e6 * X, y)
    Z, _ = data(10, 1)
    for ours, theirs in zip(scaled.predict(1e6 * Z), posterior.predict(Z), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-7)


@pytest.mark.parametrize("n", [1, 2, 30])
def test_few_repeated_and_constant_samples(n) -> None:
    X, y = data(n)
    for inputs, outputs in ((X, y), (np.repeat(X[:1], n, axis=0), y), (X, np.zeros(n))):
        mean, variance = LocalGP(GP, capacity=5).condition(inputs, outputs).predict(X)
        assert np.all(np.isfinite(mean))
        assert np.all(variance > 0.0)


def test_impossible_input_is_refused_and_leaves_the_models_as_they_were() -> None:
    X, y = data(10)
    for bad in (np.nan, np.inf):
        with pytest.raises(DataError, match="NaN or infinite"):
            LOCAL.condition(np.where(X[3, 1] == X, bad, X), y)
    with pytest.raises(UsageError, match="expected inputs"):
        LOCAL.condition(X[:, :2], y)
    with pytest.raises(UsageError, match="expected inputs"):
        LocalGP(GP).condition(X[:, :2], y)
    with pytest.raises(UsageError, match="fitted"):
        LocalGP(GP).begin()
    models = LOCAL.begin()
    np.testing.assert_array_equal(models.predict(X)[1], np.full(10, np.exp(2.0 * GP.theta[0])))
    with pytest.raises(DataError, match="no sample"):
        models.posterior()
    models.observe(X[0], y[0])
    with pytest.raises(DataError, match="NaN or infinite"):
        models.observe(X[1], np.nan)
    with pytest.raises(UsageError, match="expected inputs"):
        models.observe(X[1, :2], 0.0)
    assert models.samples == len(models.centres) == 1
    for changes in ({"capacity": 0}, {"nearest": 0}, {"generate": 1.0}, {"lengths": np.array([1.0, -1.0])}):
        with pytest.raises(UsageError):
            replace(LOCAL, **changes)


def test_it_survives_the_disk() -> None:
    posterior, (Z, _) = LOCAL.condition(*data(100)), data(9, 1)
    arrays = {f"a.{name}": array for name, array in posterior_arrays(posterior).items()}
    again = posterior_of(posterior_metadata(posterior), arrays, "a.")
    for ours, theirs in zip(again.predict(Z), posterior.predict(Z), strict=True):
        np.testing.assert_array_equal(ours, theirs)
