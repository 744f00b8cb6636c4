"""Random features: their products are the kernel's values, term by term."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arm_kernel import structured_kernel

from etude.errors import UsageError
from etude.models import ExactGP, Linear, SquaredExponential
from etude_sparse import IncrementalSpectrum
from etude_sparse.random_features import PER_INPUT, FeatureProcess, random_features

RNG = np.random.default_rng
X = RNG(0).normal(size=(25, 10))


def approximation(kernel, theta, most=4000, seed=1) -> np.ndarray:
    P = random_features(kernel, theta, 10, most, RNG(seed)).transform(X)
    return P @ P.T


def test_linear_parts_are_exact() -> None:
    kernel = Linear((1, 4, 7))
    theta = np.array([0.3, -0.5, 0.1])
    np.testing.assert_allclose(approximation(kernel, theta), kernel.value(theta, X, X), rtol=1e-12)


@pytest.mark.parametrize(
    "kernel",
    [
        SquaredExponential((2,)),
        SquaredExponential((0, 3)),
        Linear((1, 5)) * SquaredExponential((2,), unit=True),
        structured_kernel(2, 1, 2),
    ],
)
def test_many_features_come_near_the_kernel_on_average_over_draws(kernel) -> None:
    theta = 0.3 * RNG(2).normal(size=kernel.size)
    wanted = kernel.value(theta, X, X)
    mean = np.mean([approximation(kernel, theta, seed=s) for s in range(60)], axis=0)
    assert np.abs(mean - wanted).max() < 0.12 * np.abs(wanted).max()


def test_strata_serve_a_term_of_one_input_better_than_plain_draws() -> None:
    kernel, theta = SquaredExponential((2,)), np.array([0.0, 0.0])
    near = np.clip(X, -1.0, 1.0)
    wanted = kernel.value(theta, near, near)
    errors = np.zeros(2)
    for seed in range(40):
        features = random_features(kernel, theta, 10, 100, RNG(seed))
        assert (len(features.frequencies), features.size) == (PER_INPUT, 2 * PER_INPUT)
        plain = RNG(seed).normal(size=(PER_INPUT, 10)) * (np.arange(10) == 2)
        for k, own in enumerate((features, replace(features, frequencies=plain))):
            P = own.transform(near)
            errors[k] += np.mean((P @ P.T - wanted) ** 2)
    assert errors[0] < 0.2 * errors[1]


def test_counts_inputs_and_size_agree_with_the_matrix() -> None:
    kernel = structured_kernel(2, 0, 2)
    features = random_features(kernel, np.zeros(kernel.size), 10, 30, RNG(4))
    assert features.inputs == 10
    assert features.transform(X).shape == (25, features.size)
    # posture 20, own position 10, friction 2 x 10 waves of 2 columns, 8 linear, remainder 30
    assert features.size == 2 * 20 + 2 * 10 + 2 * 2 * 10 + 8 + 2 * 30


def test_learning_with_them_is_regression_with_their_kernel() -> None:
    kernel = Linear((0, 1)) + SquaredExponential((2,))
    theta = np.array([0.1, -0.2, 0.3, 0.2])
    features = random_features(kernel, theta, 10, 20, RNG(5))
    y = X[:, 0] + np.sin(X[:, 2])
    model = IncrementalSpectrum.start(FeatureProcess(features, 0.01, 1.0))
    for x, target in zip(X, y, strict=True):
        model.update(x, target)
    P = features.transform(X)
    wanted = P @ P.T @ np.linalg.solve(P @ P.T + 0.01 * np.eye(25), y)
    np.testing.assert_allclose([model.mean(x) for x in X], wanted, atol=1e-9)
    exact = ExactGP(kernel, theta, 0.5 * np.log(0.01)).condition(X, y).predict(X)[0]
    assert np.abs(wanted - exact).max() < 0.2
    with pytest.raises(UsageError, match="no posterior"):
        _ = model.posterior


def test_refusals() -> None:
    with pytest.raises(UsageError, match="one frequency"):
        random_features(Linear((0,)), np.zeros(1), 10, 0, RNG(0))
