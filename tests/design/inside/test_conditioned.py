"""A posterior given planned samples is the one that a refit with any answers would give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from design_examples import arm_model

from etude.design import PlainBatch, latents_of
from etude.design.criteria import batch_of
from etude.design.latents import PlannedPosterior
from etude.design.solve import Conditioned, conditioned_on_planned
from etude.models import ExactGP
from etude.testing import central

RNG = np.random.default_rng(3)


def posterior():
    return latents_of(arm_model())[0].posterior


def near(count: int, rng=RNG) -> np.ndarray:
    X = posterior().X
    return X[rng.integers(len(X), size=count)] + 0.3 * X.std(axis=0) * rng.standard_normal(
        (count, X.shape[1])
    )


class Bare:
    """The same posterior by the bare contract, without shared factors."""

    def __init__(self, known) -> None:
        self.known = known

    def __getattr__(self, name: str):
        if name == "factors":
            raise AttributeError(name)
        return getattr(self.known, name)


def test_it_is_a_refit_with_the_planned_samples_where_all_count() -> None:
    known, planned, X, Z = posterior(), near(12), near(7), near(5)
    gp = ExactGP(known.kernel, known.theta, 0.5 * np.log(known.noise_variance))
    refit = gp.condition(np.concatenate([known.X, planned]), np.zeros(len(known.X) + 12))
    found = Conditioned.on(known, planned, np.where(np.arange(12) % 2, 1.0, -1.0))
    scale = known.signal_variance
    np.testing.assert_allclose(found.predict(X)[1], refit.predict(X)[1], atol=1e-8 * scale)
    np.testing.assert_allclose(found.covariance(X, Z), refit.covariance(X, Z), atol=1e-8 * scale)
    np.testing.assert_array_equal(found.predict(X)[0], known.predict(X)[0])
    assert np.all(found.predict(planned)[1] < 0.5 * known.predict(planned)[1])


def test_samples_that_do_not_count_change_nothing() -> None:
    known, planned, X = posterior(), near(9), near(6)
    gains = np.array([1.0, 0.0, 0.5, 0.0, 1.0, 0.3, 0.0, 0.0, 1.0])
    found = Conditioned.on(known, planned, gains)
    same = Conditioned.on(known, planned[gains > 0], gains[gains > 0])
    np.testing.assert_allclose(found.predict(X)[1], same.predict(X)[1], rtol=1e-10)
    # a gain d is a noise of sn^2 / d^2: d = 1/2 teaches less than 1 and more than nothing
    once, half = (
        Conditioned.on(known, planned[:1], np.array([d])).predict(planned[:1])[1] for d in (1.0, 0.5)
    )
    assert once < half < known.predict(planned[:1])[1]


@pytest.mark.thinned(2)
@pytest.mark.parametrize("seen", ["with shared factors", "by the bare contract", "planned noise", "twice"])
def test_its_gradients_are_differences(seen: str) -> None:
    known = posterior()
    base = {
        "with shared factors": known,
        "by the bare contract": Bare(known),
        "planned noise": PlannedPosterior(known, 0.1 * known.noise_variance),
        "twice": Conditioned.on(known, near(4), np.full(4, 0.9)),
    }[seen]
    found = Conditioned.on(base, near(6), RNG.uniform(0.2, 1.0, 6))
    X, Z = near(5), near(4)
    g, own, cross = RNG.standard_normal(5), RNG.standard_normal((5, 5)), RNG.standard_normal((5, 4))
    own = own + own.T
    A, B = RNG.standard_normal((5, 4)), np.zeros((5, 4))
    B = np.linalg.solve(A.T @ A, A.T @ (A @ A.T)).T  # A Bᵀ symmetric

    def value(flat) -> float:
        batch, at = batch_of(found, flat.reshape(X.shape)), batch_of(found, Z)
        C, V = batch.covariance(), batch.covariance(at)
        total = g @ batch.variance() + np.sum(own * C) + np.sum(cross * V)
        return float(total + np.sum(-(A @ B.T) * C) + np.sum(2.0 * A * V))

    batch, at = batch_of(found, X), batch_of(found, Z)
    exact = batch.gradient(variance=g, own=own, cross=(at, cross), reduction=(at, A, B))
    np.testing.assert_allclose(exact.ravel(), central(value, X.ravel()), rtol=2e-5, atol=1e-4)


def test_an_exact_process_is_refitted_with_what_would_not_be_masked() -> None:
    known, planned, X = posterior(), near(9), near(6)
    gains = np.array([1.0, -1.0, 0.5, 0.0, 1.0, 0.3, 0.0, 0.0, -0.99])
    found, told = conditioned_on_planned(known, planned, gains), np.abs(gains) > 0.9
    same = Conditioned.on(known, planned[told], np.ones(4))
    np.testing.assert_allclose(found.predict(X)[1], same.predict(X)[1], atol=1e-8 * known.signal_variance)
    np.testing.assert_allclose(found.predict(X)[0], known.predict(X)[0], atol=1e-6)
    assert found.signal_variance == known.signal_variance
    assert conditioned_on_planned(known, planned, np.zeros(9)) is known
    assert isinstance(conditioned_on_planned(Bare(known), planned, gains), Conditioned)


def test_without_shared_factors_it_is_the_same() -> None:
    known, planned, X = posterior(), near(8), near(5)
    gains = np.full(8, 0.8)
    one, other = Conditioned.on(known, planned, gains), Conditioned.on(Bare(known), planned, gains)
    assert isinstance(other.planned, PlainBatch)
    np.testing.assert_allclose(one.predict(X)[1], other.predict(X)[1], rtol=1e-8)


def test_criteria_of_parameters_still_find_the_samples() -> None:
    found = Conditioned.on(posterior(), near(3), np.ones(3))
    np.testing.assert_array_equal(found.X, posterior().X)
    assert not hasattr(found, "guide")
    assert replace(found).noise_variance == posterior().noise_variance
