"""Criteria against golden numbers, and the identities that define them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etude.design import Output, ivr, mean_variance, value_of
from etude.design.criteria import LOG_FLOOR, Reduction, batch_of, log_ivr
from etude.models import ExactGP, ExactPosterior, SquaredExponential

ONE = np.ones


def golden() -> ExactPosterior:
    """X = 0, .25, .., 1; y = sin 3x; s0^2 = 1.5, length 0.5, sn^2 = 0.01: computed elsewhere to 50 digits."""
    X = np.linspace(0.0, 1.0, 5)[:, None]
    theta = np.log([math.sqrt(1.5), 0.5])
    return ExactGP(SquaredExponential((0,)), theta, math.log(0.1)).condition(X, np.sin(3.0 * X[:, 0]))


def test_golden_numbers() -> None:
    output = Output.of(golden(), np.linspace(0.0, 1.0, 11)[:, None], 1.0)
    T = np.array([[0.6], [1.3]])
    gains = ONE((2, 1))
    assert value_of(mean_variance, [output], T, gains) == pytest.approx(0.0993098541705096, rel=1e-11)
    assert output.reference_variance.mean() == pytest.approx(0.00711642780025562, rel=1e-10)
    assert value_of(ivr, [output], T, gains) == pytest.approx(0.00115574491521168, rel=1e-10)


def test_outputs_are_divided_by_their_signal_variance() -> None:
    R, T = np.linspace(0.0, 1.0, 11)[:, None], np.array([[0.6], [1.3]])
    scaled = Output.of(golden(), R)
    assert scaled.scale == pytest.approx(1.5)
    assert value_of(ivr, [scaled], T, ONE((2, 1))) == pytest.approx(0.00115574491521168 / 1.5, rel=1e-10)
    twice = value_of(mean_variance, [scaled, scaled], T, ONE((2, 2)))
    assert twice == pytest.approx(2.0 * 0.0993098541705096 / 1.5, rel=1e-11)


def example(seed: int, n: int = 15, T: int = 6, r: int = 8) -> tuple[ExactGP, tuple[np.ndarray, ...]]:
    rng = np.random.default_rng(seed)
    gp = ExactGP(SquaredExponential((0, 1)), rng.uniform(-1.0, 0.5, 3), rng.uniform(-3.0, -0.5))
    return gp, tuple(rng.uniform(-1.0, 1.0, (m, 2)) for m in (n, T, r))


@given(st.integers(0, 10**6))
@settings(max_examples=40, deadline=None)
def test_ivr_is_the_reference_variance_before_minus_after_refit(seed: int) -> None:
    gp, (X, T, R) = example(seed)
    output = Output.of(gp.condition(X, np.zeros(len(X))), R, 1.0)
    both = np.concatenate([X, T])
    after = gp.condition(both, np.zeros(len(both))).predict(R)[1]
    gain = output.reference_variance.mean() - after.mean()
    assert value_of(ivr, [output], T, ONE((len(T), 1))) == pytest.approx(gain, rel=1e-7, abs=1e-12)
    expected = -np.mean(np.log(after + LOG_FLOOR))
    assert value_of(log_ivr, [output], T, ONE((len(T), 1))) == pytest.approx(expected, rel=1e-6, abs=1e-8)


@given(st.integers(0, 10**6))
@settings(max_examples=25, deadline=None)
def test_gains_are_noise_variances(seed: int) -> None:
    """sn^2/gain^2 as noise of a sample, by refitting in the plain way with that noise."""
    gp, (X, T, R) = example(seed)
    gains = np.random.default_rng(seed).uniform(0.1, 1.0, len(T))
    posterior = gp.condition(X, np.zeros(len(X)))
    output = Output.of(posterior, R, 1.0)
    both = np.concatenate([X, T])
    noise = gp.noise_variance * np.concatenate([np.ones(len(X)), gains**-2])
    K = gp.kernel.value(gp.theta, both, both) + np.diag(noise)
    cross = gp.kernel.value(gp.theta, both, R)
    after = gp.kernel.diagonal(gp.theta, R) - np.einsum("nr,nr->r", cross, np.linalg.solve(K, cross))
    removed = Reduction.of(output, batch_of(posterior, T), gains).values
    np.testing.assert_allclose(output.reference_variance - removed, after, rtol=1e-6, atol=1e-10)


@given(st.integers(0, 10**6))
@settings(max_examples=25, deadline=None)
def test_order_of_information(seed: int) -> None:
    """Joint <= sum of single informations <= total variance/(2 sn^2); diag(chol S)^2 - sn^2 is sequential."""
    gp, (X, T, _) = example(seed)
    batch = batch_of(gp.condition(X, np.zeros(len(X))), T)
    noise, C = gp.noise_variance, batch.covariance()
    S = C + noise * np.eye(len(T))
    joint = 0.5 * np.linalg.slogdet(S / noise)[1]
    single = 0.5 * np.sum(np.log1p(batch.variance() / noise))
    assert joint <= single + 1e-9
    assert single <= np.trace(C) / (2.0 * noise) + 1e-9
    step = np.linalg.cholesky(S).diagonal() ** 2 - noise
    for t in range(len(T)):
        known = np.concatenate([X, T[:t]])
        variance = gp.condition(known, np.zeros(len(known))).predict(T[t : t + 1])[1][0]
        assert step[t] == pytest.approx(variance, rel=1e-6, abs=1e-9)


@given(st.integers(0, 10**6))
@settings(max_examples=25, deadline=None)
def test_more_samples_never_remove_less(seed: int) -> None:
    gp, (X, T, R) = example(seed)
    output = Output.of(gp.condition(X, np.zeros(len(X))), R)
    for criterion in (ivr, log_ivr):
        values = [value_of(criterion, [output], T[:k], ONE((k, 1))) for k in range(1, len(T) + 1)]
        assert np.all(np.diff(values) >= -1e-10)
    assert values[-1] <= -math.log(LOG_FLOOR)


def test_repeating_a_sample_adds_to_the_mean_but_hardly_to_the_reduction() -> None:
    """Why the batch criteria exist: mean variance does not see that samples repeat each other."""
    gp = ExactGP(SquaredExponential((0, 1)), np.zeros(3), math.log(1e-2))
    R = np.random.default_rng(0).uniform(-1.0, 1.0, (8, 2))
    output = Output.of(gp.condition(np.zeros((1, 2)), np.zeros(1)), R)
    once, gains = np.array([[0.9, -0.9]]), ONE((2, 1))
    twice, apart = np.repeat(once, 2, axis=0), np.array([[0.9, -0.9], [0.9, 0.9]])
    single = value_of(ivr, [output], once, gains[:1])
    assert value_of(mean_variance, [output], once, gains[:1]) == pytest.approx(
        value_of(mean_variance, [output], twice, gains)
    )
    assert single < value_of(ivr, [output], twice, gains) < 1.01 * single
    assert value_of(ivr, [output], apart, gains) > 1.2 * single
