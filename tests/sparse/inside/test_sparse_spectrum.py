"""The sparse spectrum process: numbers from elsewhere, the n x n form, gradients, poor data, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from etude.errors import DataError, NumericalError, UsageError
from etude.models import ExactGP, JitterWarning, SquaredExponential, contiguous_blocks
from etude_sparse import SparseSpectrumGP, SpectralFeatures
from etude_sparse.spectral_posterior import cosine_sine

GOLDEN_X = np.linspace(0.0, 1.0, 5)[:, None]
GOLDEN = SparseSpectrumGP(np.array([[0.7], [1.9], [3.1]]), np.log([np.sqrt(1.5), 1.0]), np.log(0.1))


def held_out_z2(gp: SparseSpectrumGP, X: np.ndarray, y: np.ndarray, group: np.ndarray) -> float:
    """Mean z^2 when each group is predicted from the others."""
    z2 = np.empty_like(y)
    for number in np.unique(group):
        own = group == number
        mean, variance = gp.condition(X[~own], y[~own]).predict(X[own])
        z2[own] = (y[own] - mean) ** 2 / (variance + gp.noise_variance)
    return float(z2.mean())


def process(seed: int = 0, m: int = 6, D: int = 3, **options) -> SparseSpectrumGP:
    rng = np.random.default_rng(seed)
    return SparseSpectrumGP(
        rng.standard_normal((m, D)), rng.uniform(-0.5, 0.5, D + 1), rng.uniform(-2.5, -1.0), **options
    )


def data(n: int = 40, D: int = 3, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    X = rng.uniform(-1.0, 1.0, (n, D))
    y = np.sin(2.0 * X[:, 0]) + X[:, 1] * X[:, 2] + 0.1 * rng.standard_normal(n)
    return X, y - y.mean()


def prior_covariance(gp: SparseSpectrumGP, X: np.ndarray, Z: np.ndarray) -> np.ndarray:
    """s0²/m Σ_r cos ω_rᵀ(x - z), thesis 2.4."""
    phases = np.einsum("md,xzd->mxz", gp.points / np.exp(gp.theta[1:]), X[:, None] - Z)
    return np.exp(2.0 * gp.theta[0]) * np.cos(phases).mean(axis=0)


def test_golden_numbers() -> None:
    y = np.sin(3.0 * GOLDEN_X[:, 0])
    assert -GOLDEN.evidence(GOLDEN_X, y) == pytest.approx(1.64988032772053, rel=1e-12)
    mean, variance = GOLDEN.condition(GOLDEN_X, y).predict(np.array([[0.6]]))
    assert mean[0] == pytest.approx(0.963373864423682, rel=1e-12)
    assert variance[0] == pytest.approx(0.00528950313862576, rel=1e-11)


@given(st.integers(0, 10**6), st.integers(1, 25))
@settings(max_examples=40, deadline=None)
def test_equals_the_form_with_n_by_n_matrices(seed: int, n: int) -> None:
    gp, (X, y), (Z, _) = process(seed), data(n, seed=seed), data(4, seed=seed + 1)
    K = prior_covariance(gp, X, X) + gp.noise_variance * np.eye(n)
    cross = prior_covariance(gp, Z, X)
    posterior = gp.condition(X, y)
    assert gp.evidence(X, y) == pytest.approx(multivariate_normal(np.zeros(n), K).logpdf(y), rel=1e-9)
    np.testing.assert_allclose(posterior.predict(Z)[0], cross @ np.linalg.solve(K, y), atol=1e-10)
    covariance = prior_covariance(gp, Z, Z) - cross @ np.linalg.solve(K, cross.T)
    np.testing.assert_allclose(posterior.covariance(Z, Z), covariance, atol=1e-10)


@pytest.mark.parametrize("learned", [False, True])
@pytest.mark.parametrize("floor", [0.0, 0.2])
@pytest.mark.parametrize("n", [3, 40, 1100])
def test_gradient_of_the_likelihood(learned: bool, floor: float, n: int) -> None:
    gp, (X, y) = process(learned=learned, noise_floor=floor), data(n)
    value, gradient = gp.log_marginal_likelihood(X, y)
    assert value == gp.evidence(X, y)
    expected = np.empty_like(gradient)
    for i in range(len(gradient)):
        shift = np.zeros_like(gradient)
        shift[i] = 1e-3
        near, far = (
            gp.with_parameters(gp.parameters + k * shift).evidence(X, y)
            - gp.with_parameters(gp.parameters - k * shift).evidence(X, y)
            for k in (1.0, 2.0)
        )
        expected[i] = (8.0 * near - far) / (12.0 * 1e-3)
    np.testing.assert_allclose(gradient, expected, rtol=1e-6, atol=1e-7 * np.abs(expected).max())


def test_many_points_approach_the_full_process() -> None:
    (X, y), (Z, _) = data(60), data(30, seed=2)
    theta, rng = np.log([1.0, 0.8, 1.0, 1.2]), np.random.default_rng(3)
    full = ExactGP(SquaredExponential((0, 1, 2)), theta, np.log(0.1)).condition(X, y).predict(Z)
    errors, deficits = [], []
    for m in (25, 150, 900):
        gp = SparseSpectrumGP(rng.standard_normal((m, 3)), theta, np.log(0.1))
        posterior = gp.condition(X, y)
        errors.append(np.abs(posterior.mean(Z) - full[0]).max())
        deficits.append(float(np.median(posterior.predict(Z)[1] / full[1])))
    assert errors[2] < 0.6 * errors[0]
    assert deficits[0] < 0.8
    assert deficits[0] < deficits[1] < deficits[2] < 1.1


def test_cosines_and_sines_by_the_half_angle() -> None:
    rng = np.random.default_rng(0)
    special = np.pi * np.arange(-8, 9) / 4.0
    phases = np.concatenate([special, rng.normal(size=2000) * 50.0, [0.0, 1e-300, 1e8]])
    cosine, sine = np.empty_like(phases), np.empty_like(phases)
    cosine_sine(phases.copy(), cosine, sine)
    np.testing.assert_allclose(cosine, np.cos(phases), rtol=0.0, atol=2e-15)
    np.testing.assert_allclose(sine, np.sin(phases), rtol=0.0, atol=2e-15)


def test_features_pull_back_by_complex_step() -> None:
    rng = np.random.default_rng(0)
    features, X, G = (
        SpectralFeatures(rng.standard_normal((5, 3))),
        rng.standard_normal((4, 3)),
        rng.standard_normal((4, 10)),
    )
    expected = np.empty_like(X)
    for i, d in np.ndindex(X.shape):
        Z = X.astype(complex)
        Z[i, d] += 1e-30j
        phases = Z @ features.frequencies.T
        expected[i, d] = np.sum(G * np.hstack([np.cos(phases), np.sin(phases)])).imag / 1e-30
    np.testing.assert_allclose(features.pullback(X, G), expected, rtol=1e-12)


def test_held_out_z2_shows_the_variance_deficit() -> None:
    """Smooth motion, few spectral points: overconfident, and the calibration of all models says so."""
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 60.0, 600)
    X = np.column_stack([np.sin(0.3 * t), np.sin(0.41 * t), np.cos(0.17 * t)])
    kernel, theta = SquaredExponential((0, 1, 2)), np.log([1.0, 0.3, 0.3, 0.3])
    K = kernel.value(theta, X, X) + 1e-4 * np.eye(600)
    y = np.linalg.cholesky(K) @ rng.standard_normal(600)
    blocks = contiguous_blocks(t, np.zeros(600, dtype=np.int64), 8.0)
    gp = SparseSpectrumGP(rng.standard_normal((15, 3)), theta, np.log(0.01))
    assert held_out_z2(gp, X, y, blocks) > 10.0


def shifted(X: np.ndarray) -> np.ndarray:
    return X + np.array([100.0, -30.0, 7.0])


def test_only_differences_of_inputs_count() -> None:
    gp, (X, y), (Z, _) = process(), data(), data(5, seed=3)
    here, there = gp.condition(X, y), gp.condition(shifted(X), y)
    for a, b in zip(here.predict(Z), there.predict(shifted(Z)), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda X, y: (X, np.zeros_like(y)),
        lambda X, y: (np.repeat(X[:4], 10, axis=0), np.repeat(y[:4], 10)),
        lambda X, y: (X[:1], y[:1]),
        lambda X, y: (X[:2], y[:2]),
        lambda X, y: (np.zeros_like(X), y),
        lambda X, y: (1e6 * X, y),
    ],
    ids=["constant outputs", "repeated rows", "one point", "n < D", "constant inputs", "huge"],
)
def test_poor_data_give_a_finite_posterior(spoil) -> None:
    X, y = spoil(*data())
    gp = process(learned=True)
    value, gradient = gp.log_marginal_likelihood(X, y)
    mean, variance = gp.condition(X, y).predict(X)
    for result in (value, gradient, mean, variance):
        assert np.isfinite(result).all()
    assert np.all(variance > 0.0)
    assert np.all(variance <= gp.signal_variance * (1.0 + 1e-9))


def test_without_noise_the_noise_that_is_added_is_told() -> None:
    gp, (X, y) = replace(process(m=40), log_noise=-60.0), data(10)
    with pytest.warns(JitterWarning, match="added"):
        posterior = gp.condition(X, y)
    assert 1e-13 < posterior.noise_variance / gp.signal_variance < 1e-5
    mean, _ = posterior.predict(X)
    np.testing.assert_allclose(mean, y, atol=1e-3)
    # between the samples it remains as uncertain as a process with that noise
    Z, _ = data(20, seed=4)
    same = replace(gp, log_noise=0.5 * np.log(posterior.noise_variance)).condition(X, y)
    np.testing.assert_allclose(posterior.predict(Z)[1], same.predict(Z)[1], rtol=1e-3)
    assert np.isfinite(gp.log_marginal_likelihood(X, y)[1]).all()


def test_refusals() -> None:
    gp, (X, y) = process(learned=True), data()
    with pytest.raises(UsageError, match="expected 23 parameters of 6 learned"):
        gp.with_parameters(np.zeros(5))
    with pytest.raises(UsageError, match="expected 5 parameters of 6 fixed"):
        process().with_parameters(np.zeros(23))
    with pytest.raises(UsageError, match="expected 4 finite log hyperparameters for 3 inputs"):
        SparseSpectrumGP(gp.points, np.zeros(3), 0.0)
    with pytest.raises(UsageError, match="spectral points must be finite"):
        SparseSpectrumGP(np.zeros((0, 3)), np.zeros(4), 0.0)
    with pytest.raises(UsageError, match="log_noise"):
        SparseSpectrumGP(gp.points, gp.theta, np.nan)
    with pytest.raises(UsageError, match="noise_floor"):
        SparseSpectrumGP(gp.points, gp.theta, 0.0, noise_floor=-1.0)
    with pytest.raises(UsageError, match="spectral points have 3 inputs, the data 2"):
        gp.condition(X[:, :2], y)
    with pytest.raises(DataError, match="NaN"):
        gp.condition(X, np.full_like(y, np.nan))
    with pytest.raises(NumericalError, match="floating-point range"):
        replace(gp, log_noise=400.0).evidence(X, y)
    with pytest.raises(UsageError, match=r"expected inputs of shape \(T, 3\)"):
        gp.condition(X, y).predict(X[0])
