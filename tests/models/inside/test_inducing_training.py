"""Training of inducing-point models: where the inducing inputs start, and that learning them pays."""

from __future__ import annotations

import numpy as np
import pytest
from arm_kernel import structured_kernel

from etude.errors import DataError, UsageError
from etude.models import Prior, SquaredExponential, fit_inducing, initial_inducing
from etude.models.gp.hyperparameters import weak_prior
from etude.models.gp.inducing_training import greedy_points

FORMS = pytest.mark.parametrize("form", ["vfe", "fitc"])
METHODS = pytest.mark.parametrize("method", ["lbfgs", "minimize"])
KERNEL = SquaredExponential((0, 1))


def data(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    X = rng.uniform(-1.0, 1.0, size=(n, 2))
    return X, np.sin(4.0 * X[:, 0]) * np.cos(3.0 * X[:, 1]) + 0.05 * rng.normal(size=n)


def test_greedy_points_are_the_pivots_of_the_covariance() -> None:
    X, _ = data(60)
    theta = np.log([1.3, 0.4, 0.4])
    chosen = greedy_points(KERNEL, theta, X, 8)
    K = KERNEL.value(theta, X, X)
    for i in range(1, 8):
        C = K[:, chosen[:i]]
        left = K.diagonal() - np.einsum(
            "ij,ij->i", C, np.linalg.solve(K[np.ix_(chosen[:i], chosen[:i])], C.T).T
        )
        assert chosen[i] == np.argmax(left)


def test_greedy_points_take_no_sample_twice() -> None:
    X, _ = data(6)
    theta = np.log([1.0, 0.5, 0.5])
    assert sorted(greedy_points(KERNEL, theta, np.repeat(X, 5, axis=0), 20) // 5) == list(range(6))
    assert len(greedy_points(KERNEL, theta, X[:1], 20)) == 1
    assert len(greedy_points(KERNEL, theta, np.zeros((7, 2)), 3)) == 1
    with pytest.raises(UsageError, match="at least one inducing input"):
        greedy_points(KERNEL, theta, X, 0)


@FORMS
@METHODS
def test_learning_the_inducing_inputs_pays(form, method) -> None:
    (X, y), (T, target) = data(300), data(300, 1)
    start = initial_inducing(KERNEL, X, y, 12, form=form)
    kept = fit_inducing(start, X, y, method=method, steps=40, learn_inputs=False)
    moved = fit_inducing(start, X, y, method=method, steps=40)
    np.testing.assert_array_equal(kept.Z, start.Z)
    values = [gp.log_marginal_likelihood(X, y)[0] for gp in (start, kept, moved)]
    assert values[0] < values[1] < values[2] - 10.0
    errors = [np.mean((gp.condition(X, y).predict(T)[0] - target) ** 2) for gp in (kept, moved)]
    assert errors[1] < errors[0]
    assert errors[1] < 0.2 * target.var()


@FORMS
def test_no_worse_than_the_mean_with_the_structured_kernel(form) -> None:
    rng = np.random.default_rng(0)
    X = rng.uniform(-1.0, 1.0, (200, 8))
    X[:, 6:] = np.sign(X[:, 2:4])
    y = 40.0 * np.sin(2.0 * X[:, 0]) + 20.0 * X[:, 6]
    gp = fit_inducing(
        initial_inducing(structured_kernel(2, 0), X[:100], y[:100], 20, form=form), X[:100], y[:100]
    )
    mean, variance = gp.condition(X[:100], y[:100]).predict(X[100:])
    assert np.mean((mean - y[100:]) ** 2) < 0.05 * y.var()
    assert (variance >= 0.0).all()


def test_units_of_the_data_change_nothing() -> None:
    X, y = data(100)
    scale = np.array([1e6, 1e-3])
    plain = fit_inducing(initial_inducing(KERNEL, X, y, 8), X, y, steps=10)
    other = fit_inducing(initial_inducing(KERNEL, X * scale, 255.0 * y, 8), X * scale, 255.0 * y, steps=10)
    np.testing.assert_allclose(other.Z / scale, plain.Z, atol=1e-3)
    mean = other.condition(X * scale, 255.0 * y).predict(X[:9] * scale)[0]
    np.testing.assert_allclose(mean / 255.0, plain.condition(X, y).predict(X[:9])[0], rtol=1e-2, atol=1e-3)


@FORMS
@METHODS
@pytest.mark.parametrize(
    "spoil",
    [
        lambda X, y: (X, 0.0 * y),
        lambda X, y: (np.repeat(X[:5], 6, axis=0), np.repeat(y[:5], 6)),
        lambda X, y: (X[:1], y[:1]),
        lambda X, y: (0.0 * X, y),
        lambda X, y: (1e6 * X + 1e6, y),
        lambda X, y: (X[:9], np.round(X[:9, 0], 0)),
    ],
    ids=["constant outputs", "repeated rows", "one sample", "constant inputs", "huge", "noise-free"],
)
@pytest.mark.filterwarnings("ignore::etude.models.gp.cholesky.JitterWarning")
def test_poor_data_train_to_something_finite(form, method, spoil) -> None:
    X, y = spoil(*data(30))
    gp = fit_inducing(initial_inducing(KERNEL, X, y, 10, form=form), X, y, method=method, steps=10)
    assert np.isfinite(gp.parameters).all()
    for number in gp.condition(X, y).predict(X):
        assert np.isfinite(number).all()


def test_warm_start_floor_and_prior() -> None:
    X, y = data(80)
    start = initial_inducing(KERNEL, X, y, 8, noise_floor=0.3)
    once = fit_inducing(start, X, y, steps=5)
    again = fit_inducing(once, X, y, steps=5)
    prior = weak_prior(KERNEL, X, y)

    def density(gp) -> float:
        return gp.log_marginal_likelihood(X, y)[0] + prior.log_density(gp.parameters[:4])[0]

    assert density(again) > density(once) > density(start)
    assert again.noise_variance >= 0.09
    assert fit_inducing(once, X, y, steps=0) is once
    width = np.array([np.inf, 1e-4, np.inf, np.inf])
    held = fit_inducing(start, X, y, prior=Prior(start.parameters[:4], width))
    assert held.theta[1] == pytest.approx(start.theta[1], abs=1e-3)
    assert abs(held.theta[2] - start.theta[2]) > 0.03


def test_refusals() -> None:
    X, y = data(10)
    gp = initial_inducing(KERNEL, X, y, 4)
    with pytest.raises(UsageError, match="unknown training method"):
        fit_inducing(gp, X, y, method="adam")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="the prior covers 2 parameters"):
        fit_inducing(gp, X, y, prior=Prior(np.zeros(2), np.ones(2)))
    with pytest.raises(DataError, match="NaN"):
        fit_inducing(gp, X, np.full(10, np.nan))
