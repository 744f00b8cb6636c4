"""One kernel for several outputs: the sum of their likelihoods, its gradient, and flights left out."""

from __future__ import annotations

import numpy as np
import pytest

from etude.errors import DataError, NumericalError
from etude.models import ExactGP, Linear, SquaredExponential, initial_gp
from etude.models.gp.hyperparameters import weak_prior
from etude.models.gp.shared_exact import (
    condition_shared,
    fit_shared,
    shared_likelihood,
)

D, M = 3, 4
KERNEL = SquaredExponential((0, 1, 2)) + Linear((1, 2))
GP = ExactGP(KERNEL, KERNEL.initial(np.ones(D), 1.2), -1.5, 0.1)


def data(n: int = 30, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    X = rng.uniform(-1.0, 1.0, (n, D))
    Y = np.sin(X @ rng.normal(0.0, 2.0, (D, M))) + 0.1 * rng.normal(size=(n, M))
    return X, Y - Y.mean(axis=0)


def test_it_is_the_sum_of_separate_likelihoods() -> None:
    X, Y = data()
    value, gradient = shared_likelihood(GP, X, Y)
    separate = [GP.log_marginal_likelihood(X, y) for y in Y.T]
    assert value == pytest.approx(sum(v for v, _ in separate), rel=1e-12)
    np.testing.assert_allclose(gradient, sum(g for _, g in separate), rtol=1e-9, atol=1e-9)


def test_its_gradient_is_that_of_differences() -> None:
    X, Y = data()
    _, gradient = shared_likelihood(GP, X, Y)
    for i in range(len(gradient)):
        step = 1e-5 * np.eye(len(gradient))[i]
        ends = [shared_likelihood(GP.with_parameters(GP.parameters + s * step), X, Y)[0] for s in (1, -1)]
        assert gradient[i] == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-6, abs=1e-6)


def test_conditioning_is_that_of_each_output() -> None:
    X, Y = data()
    shared, at = condition_shared(GP, X, Y), data(seed=1)[0]
    mean, variance = shared.predict(at)
    for j, posterior in enumerate(shared.outputs):
        alone = GP.condition(X, Y[:, j])
        expected = alone.predict(at)
        np.testing.assert_allclose(mean[:, j], expected[0], rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(variance, expected[1], rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(posterior.predict(at)[0], expected[0], rtol=1e-12, atol=1e-13)
        assert posterior.L is shared.outputs[0].L
        assert posterior.L_inverse is shared.outputs[0].L_inverse
    np.testing.assert_array_equal(shared.mean(at), mean)


def test_samples_left_out_are_predicted_as_if_they_had_never_been() -> None:
    X, Y = data()
    own, rest = np.arange(10, 18), np.r_[0:10, 18:30]
    shared = condition_shared(GP, X, Y)
    without = condition_shared(GP, X[rest], Y[rest])
    mean, latent = without.predict(X[own])
    held, variance = shared.held_out(own)
    np.testing.assert_allclose(held, mean, atol=1e-10)
    np.testing.assert_allclose(variance, latent + GP.noise_variance, rtol=1e-9)
    # other targets, as if conditioned on those
    other = Y + np.sin(np.arange(30))[:, None]
    expected, _ = condition_shared(GP, X[rest], other[rest]).predict(X[own])
    np.testing.assert_allclose(shared.held_out(own, other)[0], expected, atol=1e-10)


def test_training_takes_the_best_of_several_starts() -> None:
    X, Y = data(60)
    prior = weak_prior(KERNEL, X, Y)

    def density(gp: ExactGP) -> float:
        return shared_likelihood(gp, X, Y)[0] + prior.log_density(gp.parameters)[0]

    start = initial_gp(KERNEL, X, Y, noise_floor=0.1)
    far = start.parameters + np.array([0.0, 3.0, 3.0, 3.0, 0.0, 0.0, 0.0])
    ends = [
        fit_shared(start.with_parameters(p), X, Y, steps=15, prior=prior) for p in (start.parameters, far)
    ]
    best = fit_shared(start, X, Y, steps=15, prior=prior, others=[far])
    assert density(best) == pytest.approx(max(density(end) for end in ends), rel=1e-9)
    assert density(best) > density(start)
    assert best.noise_floor == 0.1
    assert fit_shared(start, X, Y, steps=0) is start


def test_bad_data_and_hopeless_starts_are_refused() -> None:
    X, Y = data()
    for broken in (Y[:, 0], Y[:5], np.where(np.arange(30)[:, None] == 3, np.nan, Y), np.zeros((30, 0))):
        with pytest.raises(DataError):
            shared_likelihood(GP, X, broken)
        with pytest.raises(DataError):
            condition_shared(GP, X, broken)
    hopeless = GP.with_parameters(np.full(KERNEL.size + 1, 400.0))
    with pytest.raises(NumericalError), np.errstate(over="ignore", invalid="ignore"):
        fit_shared(hopeless, X, Y, steps=3)
