"""Learning one sample at a time: equal to learning at once, forgetting as weighing, no drift, bad samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import etude_sparse.incremental_spectrum as module
from etude.errors import DataError, UsageError
from etude_sparse import IncrementalSpectrum, SparseSpectrumGP
from etude_sparse.incremental_spectrum import FADING


def process(seed: int = 0, m: int = 8, D: int = 3) -> SparseSpectrumGP:
    rng = np.random.default_rng(seed)
    return SparseSpectrumGP(rng.standard_normal((m, D)), rng.uniform(-0.5, 0.5, D + 1), np.log(0.1))


def motion(n: int, seed: int = 1, rate: float = 0.02) -> tuple[np.ndarray, np.ndarray]:
    """Neighbouring samples of one smooth motion, as a robot at 100 Hz gives them."""
    rng = np.random.default_rng(seed)
    t = np.arange(n)[:, None]
    X = np.sin(rate * t * np.array([1.0, 1.3, 0.6]) + rng.uniform(0.0, 6.0, 3))
    return X, np.sin(2.0 * X[:, 0]) + X[:, 1] * X[:, 2] + 0.1 * rng.standard_normal(n)


def fed(model: IncrementalSpectrum, X: np.ndarray, y: np.ndarray) -> IncrementalSpectrum:
    for x, value in zip(X, y, strict=True):
        model.update(x, value)
    return model


@given(st.integers(0, 10**6), st.integers(1, 60), st.integers(0, 60))
@settings(max_examples=30, deadline=None)
def test_equals_learning_at_once(seed: int, n: int, split: int) -> None:
    gp, (X, y), (Z, _) = process(seed), motion(n, seed), motion(7, seed + 1)
    split = min(split, n)
    begun = IncrementalSpectrum.resume(gp, X[:split], y[:split]) if split else IncrementalSpectrum.start(gp)
    model, batch = fed(begun, X[split:], y[split:]), gp.condition(X, y)
    assert model.count == n
    mean, variance = batch.predict(Z)
    posterior = model.posterior
    np.testing.assert_allclose(posterior.predict(Z)[0], mean, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(posterior.predict(Z)[1], variance, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(posterior.covariance(Z, X), batch.covariance(Z, X), atol=1e-11)
    np.testing.assert_allclose([model.mean(z) for z in Z], mean, rtol=1e-9, atol=1e-11)


def test_before_any_sample_it_is_the_prior() -> None:
    gp = process()
    mean, variance = IncrementalSpectrum.start(gp).posterior.predict(motion(5)[0])
    np.testing.assert_array_equal(mean, np.zeros(5))
    np.testing.assert_allclose(variance, gp.signal_variance)


@pytest.mark.parametrize("forgetting", [0.3, 0.95, 0.999])
def test_forgetting_weighs_samples_and_spares_the_prior(forgetting: float) -> None:
    gp, (X, y), (Z, _) = process(), motion(90), motion(6, 2)
    X[0] = 0.0  # its sines are exactly zero
    model = fed(IncrementalSpectrum.start(gp, forgetting=forgetting), X, y)
    assert np.all(model.prior <= gp.ridge * (1.0 + 1e-12))
    assert np.all(model.prior >= (1.0 - FADING) * gp.ridge * (1.0 - 1e-12))
    weight = forgetting ** np.arange(89, -1, -1.0)
    P = gp.features.transform(X)
    A = P.T @ (weight[:, None] * P) + np.diag(model.prior)
    mean, variance = model.posterior.predict(Z)
    phi = gp.features.transform(Z)
    np.testing.assert_allclose(mean, phi @ np.linalg.solve(A, P.T @ (weight * y)), rtol=1e-8, atol=1e-10)
    expected = gp.noise_variance * np.einsum("zp,zp->z", phi, np.linalg.solve(A, phi.T).T)
    np.testing.assert_allclose(variance, expected, rtol=1e-8)
    model.refactor()
    np.testing.assert_allclose(model.prior, gp.ridge)
    whole = P.T @ (weight[:, None] * P) + gp.ridge * np.eye(len(A))
    np.testing.assert_allclose(
        model.posterior.mean(Z), phi @ np.linalg.solve(whole, P.T @ (weight * y)), rtol=1e-8, atol=1e-10
    )


def test_a_long_rest_does_not_wear_out_the_prior() -> None:
    """The same sample for long: elsewhere the uncertainty comes back to the prior's, and no further."""
    gp = process(m=20)
    model = fed(IncrementalSpectrum.start(gp, forgetting=0.99), *motion(300))
    for _ in range(3000):
        model.update(np.zeros(3), 0.0)
    far = motion(20, 5)[0] * 10.0
    _, variance = model.posterior.predict(far)
    assert np.all(variance < 1.2 * gp.signal_variance)
    assert np.median(variance) > 0.7 * gp.signal_variance
    assert np.all(np.isfinite(model.weights))


def test_a_robot_that_changes_is_followed_only_with_forgetting() -> None:
    gp = process(m=30)
    X, y = motion(4000)
    changed = np.where(np.arange(4000) < 3000, y, 1.5 * y)
    errors = []
    for forgetting in (1.0, 0.998):
        model = fed(IncrementalSpectrum.start(gp, forgetting=forgetting), X, changed)
        errors.append(np.mean((model.posterior.mean(X[-500:]) - 1.5 * y[-500:]) ** 2))
    assert errors[1] < 0.5 * errors[0]


def test_ten_thousand_updates_leave_no_drift(monkeypatch) -> None:
    monkeypatch.setattr(module, "REFACTOR_EVERY", 10**9)
    gp = replace(process(m=10), log_noise=np.log(1e-4))
    X, y = motion(10_000)
    model = fed(IncrementalSpectrum.start(gp), X, y)
    R = model.R.copy()
    A = np.triu(model.A) + np.triu(model.A, 1).T
    assert np.abs(R.T @ R - A).max() < 1e-10 * np.abs(A).max()
    batch = gp.condition(X, y)
    np.testing.assert_allclose(model.posterior.mean(X[:50]), batch.mean(X[:50]), atol=1e-6)
    model.refactor()
    np.testing.assert_allclose(model.R, R, rtol=1e-6, atol=1e-6)


def test_refactorisation_comes_by_itself(monkeypatch) -> None:
    monkeypatch.setattr(module, "REFACTOR_EVERY", 25)
    gp, (X, y) = process(), motion(60)
    model, times = IncrementalSpectrum.start(gp), []
    monkeypatch.setattr(IncrementalSpectrum, "refactor", lambda self: times.append(self.count))
    fed(model, X, y)
    assert times == [25, 50]


def test_a_posterior_taken_earlier_does_not_change() -> None:
    gp, (X, y) = process(), motion(40)
    model = fed(IncrementalSpectrum.start(gp), X[:20], y[:20])
    early, unread = model.posterior, model.posterior
    before = early.predict(X)
    fed(model, X[20:], y[20:])
    for a, b, c in zip(early.predict(X), unread.predict(X), before, strict=True):
        np.testing.assert_array_equal(a, c)
        np.testing.assert_array_equal(b, c)
    assert np.abs(model.posterior.mean(X) - before[0]).max() > 1e-3


@pytest.mark.parametrize(
    ("x", "y"), [([np.nan, 0.0, 0.0], 0.0), ([0.0, np.inf, 0.0], 1.0), ([0.0, 0.0, 0.0], np.nan)]
)
def test_a_broken_sample_is_refused_and_changes_nothing(x, y) -> None:
    model = fed(IncrementalSpectrum.start(process(), forgetting=0.99), *motion(10))
    before = [a.copy() for a in (model.A, model.R, model.b, model.prior)]
    with pytest.raises(DataError, match="NaN or infinite"):
        model.update(np.array(x), y)
    for a, b in zip((model.A, model.R, model.b, model.prior), before, strict=True):
        np.testing.assert_array_equal(a, b)
    assert model.count == 10


def test_repeated_and_huge_samples_stay_finite() -> None:
    model = IncrementalSpectrum.start(process())
    for x, y in ((np.ones(3), 1.0), (np.full(3, 1e6), -1e6), (np.zeros(3), 0.0)):
        for _ in range(200):
            model.update(x, y)
    mean, variance = model.posterior.predict(motion(10)[0])
    assert np.isfinite(mean).all()
    assert np.all((variance > 0.0) & (variance < 2.0 * model.gp.signal_variance))


def test_refusals() -> None:
    gp = process()
    for forgetting in (0.0, -1.0, 1.1, np.nan):
        with pytest.raises(UsageError, match="forgetting"):
            IncrementalSpectrum.start(gp, forgetting=forgetting)
    with pytest.raises(UsageError, match="too small for updates"):
        IncrementalSpectrum.start(replace(gp, log_noise=-20.0))
    with pytest.raises(UsageError, match="expected one input of shape"):
        IncrementalSpectrum.start(gp).update(np.zeros(2), 0.0)
    with pytest.raises(DataError, match="NaN"):
        IncrementalSpectrum.resume(gp, np.full((2, 3), np.nan), np.zeros(2))
