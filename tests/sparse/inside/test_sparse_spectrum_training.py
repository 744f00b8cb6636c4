"""Training of spectral points: the reference start, improvement, guards against memorising, poor data."""

from __future__ import annotations

import numpy as np
import pytest

import etude_sparse.sparse_spectrum_training as module
from etude.errors import DataError, UsageError
from etude.models import Prior
from etude_sparse import SparseSpectrumGP, fit_sparse_spectrum, initial_sparse_spectrum
from etude_sparse.sparse_spectrum_training import held_out_error, redrawn

METHODS = pytest.mark.parametrize("method", ["lbfgs", "minimize"])


def motion(seed: int, n: int = 120) -> tuple[np.ndarray, np.ndarray]:
    """One smooth trajectory of three inputs, with noisy outputs centred by a common offset of zero."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 20.0, n)
    phase, rate = rng.uniform(0.0, 6.0, 3), rng.uniform(0.3, 0.9, 3)
    X = np.sin(rate * t[:, None] + phase)
    y = np.sin(2.0 * X[:, 0]) + X[:, 1] * X[:, 2] + 0.1 * rng.standard_normal(n)
    return X, y


def start(X: np.ndarray, y: np.ndarray, count: int = 20, draws: int = 5, **options) -> SparseSpectrumGP:
    return initial_sparse_spectrum(X, y, count, np.random.default_rng(0), draws=draws, **options)


def test_reference_start() -> None:
    X, y = motion(0)
    gp = start(X, y)
    half = 0.5 * (X.max(axis=0) - X.min(axis=0))
    np.testing.assert_allclose(np.exp(gp.theta), np.append(np.sqrt(np.mean(y * y)), half))
    assert gp.noise_variance == pytest.approx(np.mean(y * y) / 4.0)
    assert gp.points.shape == (20, 3)
    rng = np.random.default_rng(0)
    drawn = [redrawn(gp, X, y, rng, draws=1) for _ in range(5)]
    likeliest = max(drawn, key=lambda one: one.evidence(X, y))
    np.testing.assert_array_equal(gp.points, likeliest.points)
    assert min(one.evidence(X, y) for one in drawn) < gp.evidence(X, y)


def test_points_are_drawn_for_a_squared_exponential() -> None:
    X, y = motion(0)
    points = start(X, y, count=4000, draws=1).points
    assert abs(points.mean()) < 0.05
    assert points.std() == pytest.approx(1.0, abs=0.03)


@METHODS
def test_training_predicts_another_motion(method) -> None:
    X, y = motion(0, 300)
    Z, target = motion(1)
    for learned in (False, True):
        begun = start(X, y, learned=learned)
        gp = fit_sparse_spectrum(begun, X, y, method=method, steps=30)
        assert gp.evidence(X, y) > begun.evidence(X, y) + 50.0
        assert np.mean((gp.condition(X, y).mean(Z) - target) ** 2) < 0.25 * target.var()
        assert np.array_equal(gp.points, begun.points) != learned
        assert 0.05 < np.sqrt(gp.noise_variance) < 0.2


def test_the_prior_on_points_holds_them() -> None:
    X, y = motion(0, 60)
    begun = start(X, y, count=30, learned=True)
    held = fit_sparse_spectrum(begun, X, y, steps=60, prior=None, point_prior=True)
    free = fit_sparse_spectrum(held, X, y, steps=60, prior=None, point_prior=False)
    assert free.evidence(X, y) > held.evidence(X, y)
    assert np.sum(held.features.frequencies**2) < np.sum(free.features.frequencies**2)


@METHODS
def test_the_most_probable_points_balance_likelihood_and_prior(method) -> None:
    X, y = motion(0, 40)
    begun = start(X, y, count=3, learned=True)
    gp = fit_sparse_spectrum(begun, X, y, method=method, steps=400, prior=None)
    slope = gp.log_marginal_likelihood(X, y)[1][5:]
    np.testing.assert_allclose(slope, gp.points.ravel(), atol=2e-2)
    # points and lengths do not shrink together
    np.testing.assert_array_equal(gp.theta[1:], begun.theta[1:])
    assert np.abs(gp.points).max() > 0.3


def test_a_held_out_trajectory_stops_the_memorising() -> None:
    """Few samples, many learned points: the likelihood alone ends far worse than where it passed through."""
    X, y = motion(0, 50)
    held_out = motion(2)
    begun = start(X, y, count=40, learned=True)
    options = {"steps": 150, "prior": None, "point_prior": False}
    alone = fit_sparse_spectrum(begun, X, y, **options)
    stopped = fit_sparse_spectrum(begun, X, y, held_out=held_out, **options)
    assert alone.evidence(X, y) > stopped.evidence(X, y)
    scores = [held_out_error(gp, (X, y), held_out) for gp in (begun, alone, stopped)]
    assert scores[2] < 0.8 * scores[1]
    assert scores[2] <= scores[0]
    longer = fit_sparse_spectrum(begun, X, y, held_out=held_out, patience=10**6, **options)
    assert held_out_error(longer, (X, y), held_out) <= scores[2]


@METHODS
def test_patience_ends_the_training(method, monkeypatch) -> None:
    X, y = motion(0, 50)
    calls, scored = [], []
    likelihood = SparseSpectrumGP.log_marginal_likelihood

    def counted(self, X, y):
        calls.append(1)
        return likelihood(self, X, y)

    def scoring(*arguments):
        scored.append(1)
        return held_out_error(*arguments)

    monkeypatch.setattr(SparseSpectrumGP, "log_marginal_likelihood", counted)
    monkeypatch.setattr(module, "held_out_error", scoring)
    begun = start(X, y, count=40, learned=True)
    counts = []
    for patience in (1, 10**6):
        calls.clear()
        scored.clear()
        fit_sparse_spectrum(
            begun, X, y, method=method, steps=100, prior=None, point_prior=False,
            held_out=motion(2), patience=patience,
        )  # fmt: skip
        counts.append(len(calls))
        assert 0 < len(scored) < len(calls)  # only where the objective fell
    assert counts[0] < 0.5 * counts[1]


@METHODS
def test_warm_start(method) -> None:
    X, y = motion(0)
    once = fit_sparse_spectrum(start(X, y, learned=True), X, y, method=method, steps=5, prior=None)
    again = fit_sparse_spectrum(once, X, y, method=method, steps=5, prior=None, point_prior=False)
    assert again.evidence(X, y) > once.evidence(X, y)
    assert fit_sparse_spectrum(once, X, y, steps=0) is once


@METHODS
@pytest.mark.parametrize(
    "spoil",
    [
        lambda X, y: (X, np.zeros_like(y)),
        lambda X, y: (np.repeat(X[:5], 6, axis=0), np.repeat(y[:5], 6)),
        lambda X, y: (X[:1], y[:1]),
        lambda X, y: (X[:2], y[:2]),
        lambda X, y: (np.zeros_like(X), y),
        lambda X, y: (X * 1e6, 1e-6 * y),
        lambda X, y: (X, X[:, 0]),
    ],
    ids=["constant outputs", "repeated rows", "one point", "n < D", "constant inputs", "huge", "noise-free"],
)
@pytest.mark.filterwarnings("ignore::etude.models.gp.cholesky.JitterWarning")
def test_poor_data_train_to_something_finite(method, spoil) -> None:
    X, y = spoil(*motion(0, 40))
    gp = fit_sparse_spectrum(start(X, y, learned=True), X, y, method=method, steps=15)
    mean, variance = gp.condition(X, y).predict(X)
    for result in (gp.parameters, mean, variance):
        assert np.isfinite(result).all()


def test_units_of_the_data_change_nothing() -> None:
    X, y = motion(0)
    scale = np.array([1e3, 1e-3, 57.3])
    plain = fit_sparse_spectrum(start(X, y, learned=True), X, y, steps=8).condition(X, y)
    other = fit_sparse_spectrum(
        start(X * scale, 255.0 * y, learned=True), X * scale, 255.0 * y, steps=8
    ).condition(X * scale, 255.0 * y)
    np.testing.assert_allclose(other.mean(X[:9] * scale) / 255.0, plain.mean(X[:9]), rtol=1e-3, atol=1e-4)


def test_refusals() -> None:
    X, y = motion(0, 20)
    gp = start(X, y)
    with pytest.raises(UsageError, match="at least one spectral point"):
        start(X, y, count=0)
    with pytest.raises(UsageError, match="at least one draw"):
        start(X, y, draws=0)
    with pytest.raises(UsageError, match="unknown training method"):
        fit_sparse_spectrum(gp, X, y, method="adam")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="patience"):
        fit_sparse_spectrum(gp, X, y, patience=0)
    with pytest.raises(UsageError, match="the prior covers 2 parameters"):
        fit_sparse_spectrum(gp, X, y, prior=Prior(np.zeros(2), np.ones(2)))
    with pytest.raises(DataError, match="NaN"):
        fit_sparse_spectrum(gp, X, np.full(20, np.nan))
    with pytest.raises(DataError, match="NaN"):
        fit_sparse_spectrum(gp, X, y, held_out=(X, np.full(20, np.nan)))
