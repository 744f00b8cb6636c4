"""Exact regression: identities, invariances, leave-one-out against refits, and what happens to bad input."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from arm_kernel import structured_kernel
from hypothesis import given, settings
from hypothesis import strategies as st

from etude.errors import DataError, NumericalError, UsageError
from etude.models import ExactGP, JitterWarning, SquaredExponential, factorise

D = 8
KERNEL = structured_kernel(2, 0)


def data(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    X = rng.uniform(-1.0, 1.0, size=(n, D))
    return X, np.sin(3.0 * X[:, 0]) + X[:, 3] + 0.1 * rng.normal(size=n)


def process(noise_floor: float = 0.05, log_noise: float = -2.0) -> ExactGP:
    return ExactGP(KERNEL, KERNEL.initial(np.ones(D), 1.2), log_noise, noise_floor)


def dense(gp: ExactGP, X: np.ndarray) -> np.ndarray:
    return gp.kernel.value(gp.theta, X, X) + gp.noise_variance * np.eye(len(X))


@pytest.mark.parametrize("floor", [0.0, 0.3])
def test_likelihood_is_the_normal_density_and_its_gradient_exact(floor: float) -> None:
    X, y = data(25)
    gp = process(floor)
    value, gradient = gp.log_marginal_likelihood(X, y)
    K = dense(gp, X)
    density = -0.5 * (y @ np.linalg.solve(K, y) + np.linalg.slogdet(2.0 * np.pi * K)[1])
    assert value == pytest.approx(density, rel=1e-12)
    for i in range(len(gradient)):
        step = np.zeros(len(gradient))
        step[i] = 1e-5
        ends = [
            gp.with_parameters(gp.parameters + s * step).log_marginal_likelihood(X, y)[0] for s in (1, -1)
        ]
        assert gradient[i] == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-6, abs=1e-7)


def test_blocks_of_columns_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    X, y = data(50)
    whole = process().log_marginal_likelihood(X, y)[1]
    monkeypatch.setattr("etude.models.gp.kernels.BLOCK", 7)
    np.testing.assert_allclose(process().log_marginal_likelihood(X, y)[1], whole, rtol=1e-10, atol=1e-10)


def test_noise_floor_cannot_be_undercut() -> None:
    assert process(0.3, log_noise=-40.0).noise_variance == pytest.approx(0.09, rel=1e-12)
    assert process(0.3, log_noise=np.log(0.4)).noise_variance == pytest.approx(0.25, rel=1e-12)


def test_interpolates_without_noise() -> None:
    X, y = data(20)
    kernel = SquaredExponential(tuple(range(D)))
    posterior = ExactGP(kernel, np.zeros(D + 1), -16.0).condition(X, y)
    mean, variance = posterior.predict(X)
    np.testing.assert_allclose(mean, y, atol=1e-8)
    assert variance.max() < 1e-9
    far_mean, far_variance = posterior.predict(np.full((1, D), 100.0))
    assert far_mean[0] == 0.0
    assert far_variance[0] == pytest.approx(1.0)


def test_leave_one_out_equals_refits() -> None:
    X, y = data(18)
    gp = process()
    posterior = gp.condition(X, y)
    variance = 1.0 / posterior.inverse.diagonal()
    mean = y - posterior.alpha * variance
    for i in range(len(y)):
        rest = np.arange(len(y)) != i
        m, v = gp.condition(X[rest], y[rest]).predict(X[i : i + 1])
        assert mean[i] == pytest.approx(m[0], abs=1e-8)
        assert variance[i] == pytest.approx(v[0] + gp.noise_variance, rel=1e-8)


@settings(max_examples=20, deadline=None)
@given(unit=st.floats(1e-6, 1e6), output_unit=st.floats(1e-6, 1e6))
def test_units_change_nothing(unit: float, output_unit: float) -> None:
    X, y = data(25)
    Z, _ = data(5, 1)
    kernel = SquaredExponential(tuple(range(D)))
    theta = kernel.initial(np.ones(D), 1.2)
    scaled = theta + np.log(np.array([output_unit, *[unit] * D]))
    plain = ExactGP(kernel, theta, -2.0).condition(X, y)
    other = ExactGP(kernel, scaled, -2.0 + np.log(output_unit)).condition(X * unit, y * output_unit)
    (m, v), (mo, vo) = plain.predict(Z), other.predict(Z * unit)
    np.testing.assert_allclose(mo / output_unit, m, rtol=1e-7, atol=1e-10)
    np.testing.assert_allclose(vo / output_unit**2, v, rtol=1e-7, atol=1e-10)


def test_an_offset_far_from_zero_costs_no_accuracy() -> None:
    X, y = data(40)
    kernel = SquaredExponential(tuple(range(D)))
    gp = ExactGP(kernel, kernel.initial(np.ones(D), 1.2), -2.0)
    near, far = gp.condition(X, y), gp.condition(X + 1e6, y)
    np.testing.assert_allclose(far.predict(X[:5] + 1e6)[0], near.predict(X[:5])[0], atol=1e-7)


def test_shared_factors_give_the_gradient_of_a_variance_reduction() -> None:
    (X, y), (Z, _), (R, _) = data(30), data(6, 2), data(4, 3)
    gp = process()
    posterior = gp.condition(X, y)
    weights = np.array([0.1, 0.4, 0.2, 0.3])
    references = posterior.factors(R)

    def value(batch: np.ndarray) -> float:
        after = gp.condition(np.vstack([X, batch]), np.zeros(36)).predict(R)[1]
        return float(weights @ (references.variance() - after))

    batch = posterior.factors(Z)
    C = batch.covariance(references)
    H = np.linalg.solve(batch.covariance() + gp.noise_variance * np.eye(6), C)
    assert np.sum(weights * H * C) == pytest.approx(value(Z), rel=1e-8)
    gradient = batch.gradient(reduction=(references, H * weights, H))
    apart = batch.gradient(own=-(H * weights) @ H.T, cross=(references, 2.0 * H * weights))
    np.testing.assert_allclose(gradient, apart, atol=1e-12)
    for index in [(0, 0), (2, 5), (5, 7)]:
        step = np.zeros_like(Z)
        step[index] = 1e-5
        assert gradient[index] == pytest.approx(
            (value(Z + step) - value(Z - step)) / 2e-5, rel=1e-6, abs=1e-9
        )


def test_more_points_never_say_less_than_the_bound_by_fewer() -> None:
    """Variances of `at_most` are at least the latent ones, hardly more far away, and its means the same."""
    rng = np.random.default_rng(1)
    for n in (150, 450):
        posterior = process().condition(*data(n))
        X = np.concatenate([rng.uniform(-1.0, 1.0, (60, D)), 40.0 + rng.uniform(-1.0, 1.0, (9, D))])
        (mean, variance), (bound_mean, bound) = posterior.predict(X), posterior.at_most(X)
        np.testing.assert_allclose(bound_mean, mean, rtol=1e-9, atol=1e-9)
        assert np.all(bound >= variance - 1e-9 * variance.max())
        assert np.all(bound <= posterior.kernel.diagonal(posterior.theta, X) + 1e-12)
        assert np.any(bound > 1.01 * variance) == (n == 450), "of few points it is the variance itself"


def test_repeated_points_warn_with_the_amount() -> None:
    X = np.zeros((6, 1))
    gp = ExactGP(SquaredExponential((0,)), np.zeros(2), -40.0)
    with pytest.warns(JitterWarning, match=r"added 1\.0e-10 to the diagonal"):
        posterior = gp.condition(X, np.ones(6))
    assert posterior.predict(X)[0] == pytest.approx(np.ones(6), abs=1e-6)


def test_an_indefinite_matrix_ends_in_a_typed_error() -> None:
    with pytest.raises(NumericalError, match="indefinite even with"):
        factorise(np.asfortranarray([[1.0, 2.0], [2.0, 1.0]]), 0.0)
    with pytest.raises(NumericalError, match="not finite"):
        factorise(np.asfortranarray([[np.nan, 0.0], [0.0, 1.0]]), 0.0)


def test_a_posterior_without_trouble_does_not_warn() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        posterior = process().condition(*data(50))
    assert posterior.jitter == 0.0


def test_bad_input_is_named() -> None:
    X, y = data(5)
    with pytest.raises(DataError, match="NaN or infinite"):
        process().condition(X, np.full(5, np.nan))
    with pytest.raises(DataError, match="got"):
        process().condition(X[:4], y)
    with pytest.raises(DataError, match="n >= 1"):
        process().condition(X[:0], y[:0])
    with pytest.raises(UsageError, match="hyperparameters, the vector has shape"):
        ExactGP(KERNEL, np.zeros(3), 0.0)
    with pytest.raises(UsageError, match="vector of shape"):
        process().with_parameters(np.zeros(KERNEL.size))
    with pytest.raises(UsageError, match="noise_floor"):
        process(-1.0)
    with pytest.raises(UsageError, match="log_noise"):
        process(log_noise=np.inf)
    with pytest.raises(UsageError, match=r"expected inputs of shape \(T, 8\)"):
        process().condition(X, y).predict(X[:, :3])
