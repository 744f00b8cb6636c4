"""All samples through fixed inducing inputs: VFE's posterior, exact with all, folds in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from learning_examples import PHYSICS, SMALL, Inputs, train, trajectories, trajectory

from etude.models import ExactGP, FixedInducing, InducingGP, SquaredExponential
from etude.models.gp.inducing import UNEXPLAINED, telling_inputs
from etude.models.gp.kernels import RestNoise
from etude.models.gp.shared_exact import condition_shared
from etude.models.store import model_bytes, model_of

RNG = np.random.default_rng(0)
X, AT = RNG.normal(size=(60, 2)), RNG.normal(size=(9, 2))
Y = np.sin(2.0 * X[:, 0]) + X[:, 1] ** 2 + 0.1 * RNG.normal(size=60)
GP = ExactGP(SquaredExponential((0, 1)), np.array([0.3, -0.2, 0.1]), np.log(0.1))


def test_it_is_the_variational_posterior_at_those_inputs() -> None:
    Z = X[::4]
    found = FixedInducing(GP, Z, X).posterior(Y)
    other = InducingGP(GP.kernel, GP.theta, GP.log_noise, Z).condition(X, Y)
    for mine, theirs in zip(found.predict(AT), other.predict(AT), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-6, atol=1e-8)


def test_through_all_samples_it_is_exact_regression() -> None:
    found, exact = FixedInducing(GP, X, X).posterior(Y), GP.condition(X, Y)
    for mine, theirs in zip(found.predict(AT), exact.predict(AT), strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-5)


def test_a_fold_left_out_is_conditioning_without_it() -> None:
    Z, out, at = X[::4], np.arange(20, 35), np.array([21, 24, 33])
    fold = np.isin(np.arange(60), out) + 3 * (np.arange(60) % 2)
    both = np.stack([Y, -2.0 * Y], axis=1)
    means, variance = FixedInducing(GP, Z, X, fold).held_out(both, [1, 4], X[at])
    mean = means[:, 0]
    np.testing.assert_allclose(means[:, 1], -2.0 * mean, rtol=1e-12)
    kept = np.setdiff1d(np.arange(60), out)
    other = InducingGP(GP.kernel, GP.theta, GP.log_noise, Z).condition(X[kept], Y[kept])
    theirs, latent = other.predict(X[at])
    np.testing.assert_allclose(mean, theirs, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(variance, latent + GP.noise_variance, rtol=1e-6)


def test_an_exact_process_predicts_anything_without_a_fold_in_closed_form() -> None:
    out = np.array([3, 4, 5, 40])
    kept = np.setdiff1d(np.arange(60), out)
    mean, variance = condition_shared(GP, X, Y[:, None]).elsewhere(out, AT)
    theirs, latent = GP.condition(X[kept], Y[kept]).predict(AT)
    np.testing.assert_allclose(mean[:, 0], theirs, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(variance, latent + GP.noise_variance, rtol=1e-7)


def test_a_fold_that_taught_nothing_changes_nothing() -> None:
    exact, latent = GP.condition(X, Y).predict(AT)
    mean, variance = condition_shared(GP, X, Y[:, None]).elsewhere(np.zeros(0, dtype=np.int64), AT)
    np.testing.assert_allclose(mean[:, 0], exact, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(variance, latent + GP.noise_variance, rtol=1e-7)
    induced = FixedInducing(GP, X[::4], X)
    np.testing.assert_allclose(
        induced.held_out(Y[:, None], [7], AT)[0][:, 0], induced.posterior(Y).predict(AT)[0], rtol=1e-6
    )


def test_noise_at_rest_is_each_sample_s_own() -> None:
    kernel = SquaredExponential((0, 1)) + RestNoise(2)
    rest = np.abs(RNG.normal(size=(60, 1)))
    gp = ExactGP(kernel, np.array([0.3, -0.2, 0.1, np.log(0.5)]), np.log(0.1))
    data, at = np.hstack([X, rest]), np.hstack([AT, 0.3 * np.ones((9, 1))])
    out = np.arange(5, 15)
    found = FixedInducing(gp, data, data, np.isin(np.arange(60), out).astype(np.int64))
    exact = gp.condition(data, Y)
    for mine, theirs in zip(found.posterior(Y).predict(at), exact.predict(at), strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-5)
    kept = np.setdiff1d(np.arange(60), out)
    theirs, latent = gp.condition(data[kept], Y[kept]).predict(at)
    mean, variance = found.held_out(Y[:, None], [1], at)
    np.testing.assert_allclose(mean[:, 0], theirs, atol=1e-5)
    np.testing.assert_allclose(variance, latent + gp.noise_variance, atol=1e-5)


def test_inputs_that_others_explain_are_left_out() -> None:
    rounding = 1e-9 * RNG.normal(size=X.shape)
    kept = telling_inputs(GP, np.concatenate([X, X + rounding]))
    assert 20 < len(kept) <= 60
    order = [np.flatnonzero((np.concatenate([X, X + rounding]) == row).all(axis=1))[0] for row in kept]
    assert order == sorted(order)
    left = GP.condition(kept, np.zeros(len(kept)))
    explained = replace(left, noise_variance=1e-9).predict(X)[1]
    assert explained.max() <= UNEXPLAINED * GP.noise_variance * (1.0 + 1e-3) + 1e-9
    found, whole = FixedInducing(GP, kept, X).posterior(Y), FixedInducing(GP, X, X).posterior(Y)
    for mine, theirs in zip(found.predict(AT), whole.predict(AT), strict=True):
        np.testing.assert_allclose(mine, theirs, atol=0.1 * np.exp(GP.log_noise))


def test_what_is_hardly_there_has_inputs_too() -> None:
    faint = replace(GP, theta=np.array([0.3, -0.2, -8.0]))
    assert 1 < len(telling_inputs(faint, X)) == len(telling_inputs(replace(faint, log_noise=2.0), X))


def test_a_campaign_with_many_samples_learns_from_all_of_them() -> None:
    config = replace(SMALL, points=40, inducing=60, fit_points=60, steps=5)
    model = train(trajectories(2), config)
    (process,) = (c.process for c in model.candidates if c.commands == (0,))
    assert 30 < len(process.own[0].basis) <= 60
    assert len(process.guides[0].X) == 40  # what designs see, and what goes on learning on line
    few = train(trajectories(2), replace(config, inducing=1000))
    assert len(few.candidates[0].process.own[0].X) == 40
    X = model.inputs.of_log(trajectory(9).log)
    again = model_of(model_bytes(model), Inputs().restore, PHYSICS)
    np.testing.assert_array_equal(again.candidates[0].process.predict(X)[0], process.predict(X)[0])
