"""Sparse online regression: exact without deletions, both deletions, long smooth streams, bad input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arm_kernel import structured_kernel

from etude.errors import DataError, NumericalError, UsageError
from etude.models import ExactGP, SquaredExponential
from etude_sparse import SOGP, OnlineProcess

D = 3
KERNEL = SquaredExponential(tuple(range(D)))
THETA = np.log([1.2, 0.7, 0.9, 0.8])
PRIOR = SOGP(KERNEL, THETA, np.log(0.2), noise_floor=0.1, capacity=60)
FORMS = pytest.mark.parametrize("deletion", ["A", "B"])


def data(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    X = rng.uniform(-2.0, 2.0, size=(n, D))
    return X, np.sin(2.0 * X[:, 0]) + X[:, 1] * X[:, 2] + 0.1 * rng.normal(size=n)


def smooth(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Neighbours on a motion sampled at 100 Hz: each sample almost repeats the one before."""
    rng = np.random.default_rng(3)
    rates, phases = rng.uniform(0.2, 1.5, (D, 4)), rng.uniform(0.0, 6.0, (D, 4))
    X = np.sin(0.01 * np.arange(n)[:, None, None] * rates + phases).sum(axis=2) / 2.0
    return X, np.sin(2.0 * X[:, 0]) + X[:, 1] * X[:, 2] + 0.1 * rng.normal(size=n)


def fed(prior: SOGP, X: np.ndarray, y: np.ndarray) -> OnlineProcess:
    process = prior.begin(X.shape[1])
    for x, target in zip(X, y, strict=True):
        process.update(x, target)
    return process


@pytest.mark.parametrize("seed", range(3))
def test_without_deletion_it_is_exact_regression_in_any_order(seed) -> None:
    X, y = data(40)
    order = np.random.default_rng(seed).permutation(40)
    process = fed(PRIOR, X[order], y[order])
    K = KERNEL.value(THETA, X[order], X[order])
    inverse = np.linalg.inv(K + PRIOR.noise_variance * np.eye(40))
    np.testing.assert_allclose(process.alpha, inverse @ y[order], atol=1e-8)
    np.testing.assert_allclose(process.C, -inverse, atol=1e-8)
    np.testing.assert_allclose(process.Q @ K, np.eye(40), atol=1e-8)
    exact = ExactGP(KERNEL, THETA, PRIOR.log_noise, 0.1)
    assert process.log_density == pytest.approx(exact.log_marginal_likelihood(X, y)[0], rel=1e-9)
    (T, _), full = data(9, 1), exact.condition(X, y)
    for model in (process, process.posterior(), PRIOR.condition(X[order], y[order])):
        for ours, theirs in zip(model.predict(T), full.predict(T), strict=True):
            np.testing.assert_allclose(ours, theirs, atol=1e-8)
    np.testing.assert_allclose(process.posterior().covariance(T, X[:4]), full.covariance(T, X[:4]), atol=1e-8)


def test_repeated_samples_are_projected_without_loss() -> None:
    X, y = data(12)
    X, y = np.repeat(X, 4, axis=0), np.repeat(y, 4) + np.tile([0.1, -0.2, 0.3, 0.0], 12)
    process = fed(replace(PRIOR, capacity=12), X, y)
    assert len(process.basis) == 12
    full = ExactGP(KERNEL, THETA, PRIOR.log_noise, 0.1).condition(X, y)
    T, _ = data(9, 1)
    for ours, theirs in zip(process.predict(T), full.predict(T), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-8)


def test_only_novel_samples_join_the_basis() -> None:
    X, y = data(60)
    process = replace(PRIOR, tolerance=0.3).begin(D)
    process.update(X[0], y[0])
    noise_free = ExactGP(KERNEL, THETA, -12.0)
    for x, target in zip(X[1:], y[1:], strict=True):
        known = process.basis
        novelty = noise_free.condition(known, known[:, 0]).predict(x[None])[1][0]
        process.update(x, target)
        assert len(process.basis) - len(known) == (novelty > 0.3 * 1.2**2)
    assert 5 < len(process.basis) < 55


def test_each_update_predicts_before_it_learns() -> None:
    X, y = data(10)
    process = fed(PRIOR, X[:9], y[:9])
    mean, variance = process.predict(X[9:])
    assert process.update(X[9], y[9]) == pytest.approx((mean[0], variance[0] + PRIOR.noise_variance))


@FORMS
@pytest.mark.parametrize("i", [0, 7, 19])
def test_deletion_is_the_published_one(deletion, i) -> None:
    """Csató and Opper 2002 in their own quantities, with * the i-th column without its own entry."""
    process = fed(replace(PRIOR, deletion=deletion), *data(20))
    alpha, C, Q, basis = process.alpha, process.C, process.Q, process.basis
    rest = np.arange(20) != i
    Qs, Cs, q, c, a = Q[rest, i], C[rest, i], Q[i, i], C[i, i], alpha[i]
    if deletion == "A":
        alpha = alpha[rest] - a * Qs / q
        C = C[np.ix_(rest, rest)] + c * np.outer(Qs, Qs) / q**2 - (np.outer(Qs, Cs) + np.outer(Cs, Qs)) / q
    else:
        alpha = alpha[rest] - a * (Qs + Cs) / (q + c)
        C = C[np.ix_(rest, rest)] + np.outer(Qs, Qs) / q - np.outer(Qs + Cs, Qs + Cs) / (q + c)
    process._delete(i)
    np.testing.assert_array_equal(process.basis, basis[rest])
    np.testing.assert_allclose(process.alpha, alpha, atol=1e-8)
    np.testing.assert_allclose(process.C, C, atol=1e-8)
    np.testing.assert_allclose(process.Q, Q[np.ix_(rest, rest)] - np.outer(Qs, Qs) / q, atol=1e-8)


def test_form_a_keeps_mean_and_covariance_at_the_remaining_points() -> None:
    process = fed(PRIOR, *data(20))
    before = process.posterior()
    process._delete(11)
    after, kept = process.posterior(), process.basis
    np.testing.assert_allclose(after.mean(kept), before.mean(kept), atol=1e-10)
    np.testing.assert_allclose(after.covariance(kept, kept), before.covariance(kept, kept), atol=1e-10)


def test_form_b_loses_less_of_the_mean_at_the_deleted_point() -> None:
    loss = {"A": 0.0, "B": 0.0}
    for deletion in loss:
        for i in range(20):
            process = fed(replace(PRIOR, deletion=deletion), *data(20))
            before = process.posterior()
            process._delete(i)
            loss[deletion] += abs(process.posterior().mean(before.basis)[i] - before.mean(before.basis)[i])
    assert loss["B"] < loss["A"]


@FORMS
def test_at_capacity_the_weakest_point_goes(deletion) -> None:
    X, y = data(50)
    whole = fed(replace(PRIOR, capacity=16), X[:16], y[:16])
    roomy = fed(replace(PRIOR, capacity=17), X[:17], y[:17])
    scores = roomy.alpha**2 / (roomy.Q + roomy.C).diagonal()
    np.testing.assert_allclose(roomy.scores(), scores, rtol=1e-8)
    whole.update(X[16], y[16])
    np.testing.assert_array_equal(whole.basis, np.delete(X[:17], np.argmin(scores), axis=0))
    process = fed(replace(PRIOR, capacity=16, deletion=deletion), X, y)
    assert len(process.basis) == 16
    assert process.samples == 50
    K = KERNEL.value(THETA, process.basis, process.basis)
    np.testing.assert_allclose(process.Q @ K, np.eye(16), atol=1e-8)


@pytest.mark.thinned
@FORMS
@pytest.mark.parametrize("tolerance", [1e-8, 1e-6, 1e-3])
@pytest.mark.parametrize("noise", [1.1e-5, 1e-3, 0.1])
def test_a_long_smooth_stream_stays_sound(deletion, tolerance, noise) -> None:
    X, y = smooth(1500)
    prior = SOGP(KERNEL, np.zeros(4), np.log(noise), capacity=30, deletion=deletion, tolerance=tolerance)
    process = fed(prior, X, y)
    K = KERNEL.value(prior.theta, process.basis, process.basis)
    np.testing.assert_allclose(process._L @ process._L.T, K, atol=1e-10)
    eigenvalues = np.linalg.eigvalsh(process._S)
    assert eigenvalues.min() > -1e-12
    assert eigenvalues.max() < 1.0 + 1e-9
    mean, variance = process.predict(X)
    assert np.isfinite(mean).all()
    assert variance.max() <= 1.0 + 1e-9
    if noise == 0.1:
        assert np.mean((mean - y) ** 2) < 0.1 * y.var()
        copy = process.posterior()
        np.testing.assert_allclose(copy.predict(X[::50])[0], mean[::50], atol=1e-6)
        np.testing.assert_allclose(copy.predict(X[::50])[1], variance[::50], atol=1e-6)


@FORMS
def test_gradients_after_deletions(deletion) -> None:
    posterior = replace(PRIOR, capacity=14, deletion=deletion).condition(*data(60))
    X, Z = data(4, 5)[0], data(3, 6)[0]
    G, g = np.random.default_rng(7).normal(size=(4, 3)), np.array([1.0, -2.0, 0.5, 3.0])
    pairs = [
        (posterior.mean_gradient(X), lambda x: posterior.predict(x)[0].sum()),
        (posterior.variance_gradient(X, g), lambda x: g @ posterior.predict(x)[1]),
        (posterior.covariance_gradient(X, Z, G), lambda x: np.sum(G * posterior.covariance(x, Z))),
    ]
    for gradient, function in pairs:
        for index in np.ndindex(X.shape):
            step = np.zeros_like(X)
            step[index] = 1e-5
            slope = (function(X + step) - function(X - step)) / 2e-5
            assert gradient[index] == pytest.approx(slope, rel=1e-6, abs=1e-8)


def test_a_posterior_is_a_copy() -> None:
    X, y = data(60)
    process = fed(replace(PRIOR, capacity=20), X[:30], y[:30])
    posterior = process.posterior()
    before = posterior.predict(X)
    for x, target in zip(X[30:], y[30:], strict=True):
        process.update(x, target)
    for ours, theirs in zip(posterior.predict(X), before, strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.thinned
@pytest.mark.parametrize("capacity", [1, 2, 10])
@pytest.mark.parametrize(
    "spoil",
    [
        lambda X, y: (X, 0.0 * y),
        lambda X, y: (0.0 * X, y),
        lambda X, y: (X[:1], y[:1]),
        lambda X, y: (1e6 * X, y),
        lambda X, y: (X, 1e6 * y),
        lambda X, y: (X + 1e6, np.sin(X[:, 0])),
    ],
    ids=["constant outputs", "constant inputs", "one sample", "huge inputs", "huge outputs", "noise-free"],
)
@FORMS
def test_poor_streams_give_finite_numbers(spoil, capacity, deletion) -> None:
    X, y = spoil(*data(40))
    process = fed(replace(PRIOR, capacity=capacity, deletion=deletion), X, y)
    for number in (*process.predict(X), *process.posterior().predict(X)):
        assert np.isfinite(number).all()
    assert (process.predict(X)[1] <= 1.2**2 + 1e-9).all()


def test_units_change_nothing() -> None:
    X, y = data(60)
    small = replace(PRIOR, capacity=15)
    scales = np.log(np.array([255.0, 1e6, 1e6, 1e6]))
    other = replace(small, theta=THETA + scales, log_noise=np.log(0.2 * 255.0), noise_floor=25.5)
    m, v = fed(small, X, y).predict(X)
    mo, vo = fed(other, X * 1e6, y * 255.0).predict(X * 1e6)
    np.testing.assert_allclose(mo / 255.0, m, atol=1e-7)
    np.testing.assert_allclose(vo / 255.0**2, v, atol=1e-7)


def test_a_kernel_that_vanishes_somewhere() -> None:
    """The structured kernel's linear terms are zero at rest, and of low rank everywhere."""
    kernel = structured_kernel(2, 0)
    prior = SOGP(kernel, kernel.initial(np.ones(8), 1.2), -2.0, capacity=10)
    X = np.vstack([np.zeros((3, 8)), np.random.default_rng(0).normal(size=(40, 8))])
    process = fed(prior, X, X[:, 3])
    assert np.isfinite(process.predict(X)[0]).all()


def test_bad_samples_are_refused_and_change_nothing() -> None:
    X, y = data(20)
    process = fed(PRIOR, X, y)
    before = process.predict(X)
    for x, target in ((np.full(D, np.nan), 0.0), (X[0], np.nan), (X[0], np.inf)):
        with pytest.raises(DataError, match="a sample contains NaN"):
            process.update(x, target)
    with pytest.raises(UsageError, match=r"expected an input of shape \(3,\)"):
        process.update(X[0, :2], 0.0)
    with pytest.raises(UsageError, match=r"expected inputs of shape \(T, 3\)"):
        process.predict(X[:, :2])
    for ours, theirs in zip(process.predict(X), before, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert process.samples == 20


def test_before_the_first_sample() -> None:
    X, _ = data(5)
    process = PRIOR.begin(D)
    np.testing.assert_array_equal(process.predict(X)[0], 0.0)
    np.testing.assert_allclose(process.predict(X)[1], 1.2**2)
    with pytest.raises(DataError, match="no sample yet"):
        process.posterior()


def test_refusals() -> None:
    X, y = data(5)
    with pytest.raises(NumericalError, match="too little for an online process"):
        replace(PRIOR, log_noise=-30.0, noise_floor=0.0).condition(X, y)
    with pytest.raises(DataError, match="NaN or infinite"):
        PRIOR.condition(X, np.full(5, np.nan))
    with pytest.raises(UsageError, match="hyperparameters, the vector has shape"):
        replace(PRIOR, theta=np.zeros(2))
    for name, value in [
        ("capacity", 0),
        ("deletion", "C"),
        ("tolerance", 0.0),
        ("tolerance", 1.0),
        ("log_noise", np.nan),
        ("noise_floor", -1.0),
    ]:
        with pytest.raises(UsageError, match=name):
            replace(PRIOR, **{name: value})


def test_the_mean_at_one_point_is_the_prediction() -> None:
    X, y = data(80)
    process = PRIOR.begin(D)
    assert process.mean(X[0]) == 0.0
    for x, target in zip(X, y, strict=True):
        process.update(x, target)
        assert process.mean(X[3]) == pytest.approx(process.predict(X[3:4])[0][0], rel=1e-9, abs=1e-12)
