"""Five points of sin 3x against numbers computed with 50 digits (the regression by scikit-learn too)."""

from __future__ import annotations

import numpy as np
import pytest

from etude.models import ExactGP, ExactPosterior, SquaredExponential

X = np.linspace(0.0, 1.0, 5)[:, None]
Y = np.sin(3.0 * X[:, 0])
GP = ExactGP(SquaredExponential((0,)), np.log([np.sqrt(1.5), 0.5]), 0.5 * np.log(0.01))
BATCH = np.array([[0.6], [1.3]])
REFERENCE = np.linspace(0.0, 1.0, 11)[:, None]


@pytest.fixture(scope="module")
def posterior() -> ExactPosterior:
    return GP.condition(X, Y)


def test_likelihood_and_gradient() -> None:
    value, gradient = GP.log_marginal_likelihood(X, Y)
    assert -value == pytest.approx(2.3076582798724, rel=1e-12)
    expected = [2.2703385134998, -2.11053709692496, 1.00843401362214]
    np.testing.assert_allclose(-gradient, expected, rtol=1e-12)


def test_prediction(posterior: ExactPosterior) -> None:
    mean, variance = posterior.predict(BATCH[:1])
    assert mean[0] == pytest.approx(0.97462942881212, rel=1e-12)
    assert variance[0] == pytest.approx(0.00630161813176363, rel=1e-11)
    assert posterior.predict(BATCH)[1].mean() == pytest.approx(0.0993098541705096, rel=1e-11)


def test_leave_one_out(posterior: ExactPosterior) -> None:
    variance = 1.0 / posterior.inverse.diagonal()
    mean = posterior.y - posterior.alpha * variance
    assert mean[2] == pytest.approx(1.01307229720257, rel=1e-12)
    assert variance[2] == pytest.approx(0.0252646537454372, rel=1e-12)


def test_covariances_carry_the_criteria(posterior: ExactPosterior) -> None:
    """info_gain(T), the reference variance and ivr(T), straight from the posterior's covariances."""
    S = posterior.covariance(BATCH, BATCH) + 0.01 * np.eye(2)
    C = posterior.covariance(BATCH, REFERENCE)
    assert 0.5 * np.linalg.slogdet(S / 0.01)[1] == pytest.approx(1.74493241170752, rel=1e-11)
    assert posterior.predict(REFERENCE)[1].mean() == pytest.approx(0.00711642780025562, rel=1e-10)
    assert np.sum(C * np.linalg.solve(S, C)) / 11 == pytest.approx(0.00115574491521168, rel=1e-10)


def test_dictionary_member_is_the_noise_free_leave_one_out() -> None:
    exact = ExactGP(GP.kernel, GP.theta, -50.0).condition(X, Y)
    assert 1.0 / exact.inverse[2, 2] == pytest.approx(0.00361606525674058, rel=1e-9)
    assert exact.predict(BATCH[:1])[1][0] == pytest.approx(1.89220311308582e-5, rel=1e-8)
