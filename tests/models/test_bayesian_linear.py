"""Linear regression against the Gaussian process it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from etude.errors import DataError, NumericalError, UsageError
from etude.models import BayesianLinear, ExactGP, Linear


class Columns:
    """phi(x) = x."""

    def transform(self, X: np.ndarray) -> np.ndarray:
        return X

    def pullback(self, X: np.ndarray, G: np.ndarray) -> np.ndarray:
        return G


def data(n: int, scale: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(n)
    X, Z = scale * rng.standard_normal((n, 4)), scale * rng.standard_normal((6, 4))
    return X, X @ [1.0, -2.0, 0.0, 0.5] / scale + 0.1 * rng.standard_normal(n), Z


def both(s0: float, sn: float) -> tuple[BayesianLinear, ExactGP]:
    gp = ExactGP(Linear((0, 1, 2, 3)), np.full(4, np.log(s0)), np.log(sn))
    return BayesianLinear(Columns(), np.log(s0), np.log(sn)), gp


@pytest.mark.parametrize("n", [1, 3, 4, 40])
def test_it_is_the_process_with_the_linear_kernel(n: int) -> None:
    X, y, Z = data(n)
    regression, gp = both(1.5, 0.2)
    one, two = regression.condition(X, y), gp.condition(X, y)
    np.testing.assert_allclose(one.predict(Z), two.predict(Z), rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(one.covariance(Z, X), two.covariance(Z, X), atol=1e-10)
    assert one.signal_variance == pytest.approx(two.signal_variance)
    assert one.noise_variance == pytest.approx(two.noise_variance)
    value, gradient = regression.log_marginal_likelihood(X, y)
    expected, by_gp = gp.log_marginal_likelihood(X, y)
    assert value == pytest.approx(expected, rel=1e-8)
    np.testing.assert_allclose(gradient, [by_gp[:4].sum(), by_gp[4]], rtol=1e-7, atol=1e-8)


def test_inputs_at_a_million_and_almost_no_noise() -> None:
    X, y, Z = data(30, 1e6)
    posterior = BayesianLinear(Columns(), np.log(1e-6), np.log(0.1)).condition(X, y)
    np.testing.assert_allclose(posterior.predict(Z)[0], Z @ [1e-6, -2e-6, 0.0, 0.5e-6], atol=0.2)
    exact = BayesianLinear(Columns(), 0.0, np.log(1e-12)).condition(X, X @ np.ones(4))
    np.testing.assert_allclose(exact.weights, np.ones(4), rtol=1e-10)
    assert np.isfinite(exact.predict(Z)[1]).all()


def test_duplicate_rows_and_constant_outputs() -> None:
    X = np.ones((5, 4))
    mean, variance = both(1.0, 0.1)[0].condition(X, np.full(5, 2.0)).predict(np.eye(4))
    np.testing.assert_allclose(mean, 2.0 / 4.0, rtol=1e-2)
    np.testing.assert_allclose(variance, 0.75, rtol=1e-2)  # one direction of four is known


def test_what_it_refuses() -> None:
    regression, X, y = both(1.0, 0.1)[0], np.ones((3, 4)), np.zeros(3)
    with pytest.raises(DataError, match=r"inputs \(n, D\)"):
        regression.condition(X[:0], y[:0])
    with pytest.raises(DataError, match="NaN"):
        regression.condition(X, y + np.nan)
    with pytest.raises(UsageError, match=r"shape \(T, 4\)"):
        regression.condition(X, y).predict(np.ones((2, 3)))
    with pytest.raises(UsageError, match=r"expected log amplitude and log noise.*\(3,\)"):
        regression.with_parameters(np.zeros(3))
    with pytest.raises(UsageError, match="must be finite"):
        replace(regression, log_noise=-np.inf)

    class Broken(Columns):
        def transform(self, X: np.ndarray) -> np.ndarray:
            return X * np.inf

    with pytest.raises(NumericalError, match="not finite"):
        BayesianLinear(Broken(), 0.0, 0.0).condition(X, y)
