"""The shared criteria, on a sparse spectrum posterior, against their closed forms in the space of weights."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etude import plugins
from etude.design import Output, PlainBatch, criterion_named, evaluate, value_of
from etude_sparse import SparseSpectrumGP

CRITERIA = list(plugins.BUILT_IN["etude.criteria"])

ONE = np.ones


def example(seed: int, n: int = 20, T: int = 6, r: int = 9, D: int = 2):
    """Process, posterior, planned and reference inputs, and their features with A = PᵀP + (m sn²/s0²) I."""
    rng = np.random.default_rng(seed)
    m = 7
    gp = SparseSpectrumGP(rng.standard_normal((m, D)), rng.uniform(-0.5, 0.5, D + 1), rng.uniform(-2.0, -0.5))
    X, Z, R = (rng.uniform(-1.0, 1.0, (k, D)) for k in (n, T, r))

    def features(at: np.ndarray) -> np.ndarray:
        phases = at @ (gp.points / np.exp(gp.theta[1:])).T
        return np.hstack([np.cos(phases), np.sin(phases)])

    ridge = m * np.exp(2.0 * (gp.log_noise - gp.theta[0]))
    A = features(X).T @ features(X) + ridge * np.eye(2 * m)
    return gp, gp.condition(X, rng.standard_normal(n)), Z, R, features(Z), features(R), A


def test_information_of_the_golden_batch() -> None:
    X = np.linspace(0.0, 1.0, 5)[:, None]
    gp = SparseSpectrumGP(np.array([[0.7], [1.9], [3.1]]), np.log([np.sqrt(1.5), 1.0]), np.log(0.1))
    output = Output.of(gp.condition(X, np.sin(3.0 * X[:, 0])), np.zeros((0, 1)))
    batch = np.array([[0.6], [1.3]])
    value = value_of(criterion_named("info_gain"), [output], batch, ONE((2, 1)))
    assert value == pytest.approx(1.39520881743265, rel=1e-10)


@given(st.integers(0, 10**6))
@settings(max_examples=30, deadline=None)
def test_closed_forms(seed: int) -> None:
    gp, posterior, Z, R, P, P_R, A = example(seed)
    output = Output.of(posterior, R, scale=1.0)
    noise, gains, inverse = gp.noise_variance, ONE((len(Z), 1)), np.linalg.inv(A)

    def value(name: str) -> float:
        return value_of(criterion_named(name), [output], Z, gains)

    mean_variance = noise / len(Z) * np.sum(np.linalg.solve(np.linalg.cholesky(A), P.T) ** 2)
    assert value("mean_variance") == pytest.approx(mean_variance, rel=1e-8)
    grown = A + P.T @ P
    information = 0.5 * (np.linalg.slogdet(grown)[1] - np.linalg.slogdet(A)[1])
    assert value("info_gain") == pytest.approx(information, rel=1e-8)
    M = P_R.T @ P_R / len(R)
    ivr = noise * (np.trace(inverse @ M) - np.trace(np.linalg.solve(grown, M)))
    assert value("ivr") == pytest.approx(ivr, rel=1e-7, abs=1e-12)


@pytest.mark.parametrize("name", CRITERIA)
def test_gradients_of_every_criterion(name: str) -> None:
    _, posterior, Z, R, *_ = example(3)
    gains = np.random.default_rng(1).uniform(0.5, 1.0, (len(Z), 1))
    outputs = [Output.of(posterior, R)]
    value, in_Z, _ = evaluate(criterion_named(name), outputs, Z, gains)
    assert value == pytest.approx(value_of(criterion_named(name), outputs, Z, gains), rel=1e-12)
    expected = np.empty_like(Z)
    for index in np.ndindex(Z.shape):
        shift = np.zeros_like(Z)
        shift[index] = 1e-3
        near, far = (
            value_of(criterion_named(name), outputs, Z + k * shift, gains)
            - value_of(criterion_named(name), outputs, Z - k * shift, gains)
            for k in (1.0, 2.0)
        )
        expected[index] = (8.0 * near - far) / 12e-3
    np.testing.assert_allclose(in_Z, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("name", CRITERIA)
def test_shared_factors_and_the_bare_contract_agree(name: str) -> None:
    _, posterior, Z, R, *_ = example(4)

    class Bare:
        predict, covariance = posterior.predict, posterior.covariance
        covariance_gradient = posterior.covariance_gradient
        variance_gradient = posterior.variance_gradient
        noise_variance, signal_variance = posterior.noise_variance, posterior.signal_variance

    bare = Output.of(Bare(), R)  # type: ignore[arg-type]
    assert isinstance(bare.reference_batch, PlainBatch)
    gains = ONE((len(Z), 1))
    for one, two in zip(
        evaluate(criterion_named(name), [Output.of(posterior, R)], Z, gains),
        evaluate(criterion_named(name), [bare], Z, gains),
        strict=True,
    ):
        np.testing.assert_allclose(one, two, rtol=1e-8, atol=1e-10)
