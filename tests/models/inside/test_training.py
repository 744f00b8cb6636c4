"""Training: it improves, recovers what made the data, respects floor and prior, and survives poor data."""

from __future__ import annotations

import numpy as np
import pytest
from arm_kernel import structured_kernel

from etude.errors import DataError, NumericalError, UsageError
from etude.models import ExactGP, Kernel, Prior, SquaredExponential, fit, initial_gp
from etude.models.gp.hyperparameters import RATE, initial_theta, optimise, weak_prior

METHODS = pytest.mark.parametrize("method", ["lbfgs", "minimize"])
KERNELS: list[Kernel] = [SquaredExponential(tuple(range(8))), structured_kernel(2, 0)]


def arm_like(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A friction step whose height depends on posture, gravity and inertia, on [q, qd, qdd, tanh(qd/v0)]."""
    rng = np.random.default_rng(seed)
    q, qd, qdd = rng.uniform(-1, 1, (n, 2)), rng.uniform(-0.2, 0.2, (n, 2)), rng.uniform(-0.1, 0.1, (n, 2))
    step = np.tanh(qd / 0.01)
    y = 40 * np.sin(2 * q[:, 0]) + 25 * (1 + 0.3 * np.cos(3 * q[:, 1])) * step[:, 0] + 60 * qd[:, 0]
    return np.hstack([q, qd, qdd, step]), y


@METHODS
def test_recovers_the_process_that_made_the_data(method) -> None:
    rng = np.random.default_rng(0)
    X = rng.uniform(-3.0, 3.0, size=(300, 2))
    kernel = SquaredExponential((0, 1))
    truth = np.log([2.0, 0.7, 3.0])
    K = kernel.value(truth, X, X) + 0.2**2 * np.eye(300)
    y = np.linalg.cholesky(K) @ rng.normal(size=300)
    gp = fit(initial_gp(kernel, X, y), X, y, method=method, steps=60, prior=None)
    np.testing.assert_allclose(gp.theta[1:], truth[1:], atol=0.15)
    assert gp.theta[0] == pytest.approx(truth[0], abs=0.5)
    assert gp.log_noise == pytest.approx(np.log(0.2), abs=0.15)


@METHODS
@pytest.mark.parametrize("kernel", KERNELS, ids=["ard", "structured"])
@pytest.mark.parametrize("n", [4, 15, 60])
def test_predicts_better_than_the_mean_even_from_few_points(method, kernel, n) -> None:
    X, y = arm_like(n)
    Z, target = arm_like(300, 1)
    gp = fit(initial_gp(kernel, X, y, noise_floor=0.5), X, y, method=method)
    before = initial_gp(kernel, X, y, noise_floor=0.5)
    assert gp.log_marginal_likelihood(X, y)[0] > before.log_marginal_likelihood(X, y)[0] - 5.0
    mean, variance = gp.condition(X, y).predict(Z)
    assert np.isfinite(mean).all()
    assert np.sqrt(np.mean((mean - target) ** 2)) < 1.5 * target.std()
    assert np.abs(gp.parameters).max() < 12.0
    assert gp.noise_variance >= 0.25
    if n == 60:
        assert np.mean((mean - target) ** 2) < 0.1 * target.var()
        assert np.mean((mean - target) ** 2 / (variance + gp.noise_variance)) < 6.0


def test_structure_learns_the_friction_step_from_less() -> None:
    X, y = arm_like(40)
    Z, target = arm_like(300, 1)
    errors = []
    for kernel in KERNELS:
        gp = fit(initial_gp(kernel, X, y, noise_floor=0.5), X, y)
        errors.append(np.mean((gp.condition(X, y).predict(Z)[0] - target) ** 2))
    assert errors[1] < 0.5 * errors[0]


@METHODS
def test_steps_warm_start_where_the_last_training_ended(method) -> None:
    X, y = arm_like(50)
    kernel = KERNELS[0]
    once = fit(initial_gp(kernel, X, y), X, y, method=method, steps=5)
    again = fit(once, X, y, method=method, steps=5)
    prior = weak_prior(kernel, X, y)

    def objective(gp: ExactGP) -> float:
        return gp.log_marginal_likelihood(X, y)[0] + prior.log_density(gp.parameters)[0]

    assert objective(again) > objective(once) > objective(initial_gp(kernel, X, y))
    assert fit(once, X, y, method=method, steps=0) is once


@METHODS
@pytest.mark.parametrize("kernel", KERNELS, ids=["ard", "structured"])
@pytest.mark.parametrize(
    "spoil",
    [
        lambda X, y: (X, np.zeros_like(y)),
        lambda X, y: (np.repeat(X[:5], 6, axis=0), np.repeat(y[:5], 6)),
        lambda X, y: (X[:1], y[:1]),
        lambda X, y: (np.zeros_like(X), y),
        lambda X, y: (X * 1e6, y),
        lambda X, y: (X * 1e-6, y * 1e6),
        lambda X, y: (X + 1e3, y),
    ],
    ids=["constant outputs", "repeated rows", "one point", "constant inputs", "huge", "tiny", "offset"],
)
@pytest.mark.filterwarnings("ignore::etude.models.gp.cholesky.JitterWarning")
def test_poor_data_train_to_something_finite(method, kernel, spoil) -> None:
    X, y = spoil(*arm_like(30))
    gp = fit(initial_gp(kernel, X, y), X, y, method=method, steps=10)
    mean, variance = gp.condition(X, y).predict(X)
    assert np.isfinite(mean).all()
    assert np.isfinite(variance).all()
    assert np.isfinite(gp.parameters).all()


def test_units_of_the_data_change_nothing() -> None:
    X, y = arm_like(40)
    scale = np.array([1e3, 1e-3, 57.3, 57.3, 1e4, 1.0, 0.5, 2.0])
    kernel = KERNELS[1]
    plain = fit(initial_gp(kernel, X, y), X, y, steps=8).condition(X, y)
    other = fit(initial_gp(kernel, X * scale, 255.0 * y), X * scale, 255.0 * y, steps=8)
    mean = other.condition(X * scale, 255.0 * y).predict(X[:9] * scale)[0]
    np.testing.assert_allclose(mean / 255.0, plain.predict(X[:9])[0], rtol=1e-3)


def test_descent_goes_along_the_gradient_at_a_fixed_rate() -> None:
    X, y = arm_like(40)
    gp = initial_gp(KERNELS[0], X, y)
    expected = gp.parameters
    for steps in (1, 2, 3):
        gradient = gp.with_parameters(expected).log_marginal_likelihood(X, y)[1]
        expected = expected + RATE * gradient
        found = fit(gp, X, y, method="descent", steps=steps, prior=None)
        np.testing.assert_allclose(found.parameters, expected, rtol=1e-12)


def test_descent_ends_where_nothing_can_be_computed() -> None:
    wall = 1.0 - 2.5 * RATE

    def objective(x: np.ndarray) -> tuple[float, np.ndarray]:
        return (1.0, np.ones(1)) if x[0] > wall else (np.inf, np.zeros(1))

    found = optimise(objective, np.ones(1), method="descent", steps=9)
    np.testing.assert_allclose(found, 1.0 - 2.0 * RATE)
    with pytest.raises(NumericalError, match="not finite at the start"):
        optimise(objective, np.zeros(1), method="descent", steps=9)


def test_start_is_the_half_range() -> None:
    X = np.array([[0.0, 5.0], [4.0, 5.0], [1.0, 5.0]])
    theta = initial_theta(SquaredExponential((0, 1)), X, np.array([-2.0, 0.0, 2.0]))
    np.testing.assert_allclose(np.exp(theta), [np.sqrt(8.0 / 3.0), 2.0, 1.0])


def test_prior_is_a_normal_density_with_its_gradient() -> None:
    prior = Prior(np.array([0.0, 1.0]), np.array([2.0, np.inf]))
    value, gradient = prior.log_density(np.array([1.0, 7.0]))
    assert value == pytest.approx(-0.125)
    np.testing.assert_allclose(gradient, [-0.25, 0.0])


def test_a_tight_prior_holds_its_parameter() -> None:
    X, y = arm_like(40)
    gp = initial_gp(KERNELS[0], X, y)
    width = np.full(gp.parameters.shape, np.inf)
    width[3] = 1e-4
    held = fit(gp, X, y, prior=Prior(gp.parameters, width))
    assert held.theta[3] == pytest.approx(gp.theta[3], abs=1e-3)
    assert np.abs(held.theta - gp.theta).max() > 0.1


def test_refusals() -> None:
    X, y = arm_like(10)
    gp = initial_gp(KERNELS[0], X, y)
    with pytest.raises(UsageError, match="unknown training method"):
        fit(gp, X, y, method="adam")  # type: ignore[arg-type]
    for method in ("lbfgs", "descent"):
        with pytest.raises(UsageError, match="negative steps"):
            fit(gp, X, y, method=method, steps=-5)  # type: ignore[arg-type]
    with pytest.raises(DataError, match="NaN"):
        fit(gp, X, np.full(10, np.nan))
    with pytest.raises(UsageError, match="the prior covers 2 parameters"):
        fit(gp, X, y, prior=Prior(np.zeros(2), np.ones(2)))
    with pytest.raises(UsageError, match="widths must be positive"):
        Prior(np.zeros(2), np.zeros(2))
    with pytest.raises(UsageError, match="differ"):
        Prior(np.zeros(2), np.ones(3))


@METHODS
def test_a_joint_that_turned_one_way_claims_no_boundless_force_when_it_turns_back(method) -> None:
    X, y = arm_like(40)
    one_way = X[:, 2] > 0.1
    X_told, y_told = X[one_way], y[one_way]
    assert 0.0 < np.ptp(X_told[:, 6]) < 1e-7  # tanh(qd / v0) is 1 up to its last digits
    gp = fit(initial_gp(KERNELS[1], X_told, y_told, noise_floor=0.5), X_told, y_told, method=method)
    mean, variance = gp.condition(X_told, y_told).predict(X)
    size = np.abs(y).max()
    assert np.sqrt(variance).max() < 10.0 * size
    assert np.abs(mean).max() < 10.0 * size
