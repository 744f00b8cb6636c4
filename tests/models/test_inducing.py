"""Inducing-point models: golden numbers, the exact process as their limit, bounds, gradients, bad input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arm_kernel import structured_kernel
from hypothesis import given, settings
from hypothesis import strategies as st

from etude.errors import DataError, NumericalError, UsageError
from etude.models import ExactGP, InducingGP, JitterWarning, SquaredExponential

D = 8
KERNELS = {"ard": SquaredExponential(tuple(range(D))), "structured": structured_kernel(2, 0)}
FORMS = pytest.mark.parametrize("form", ["vfe", "fitc"])
BOTH = pytest.mark.parametrize("kernel", KERNELS.values(), ids=KERNELS.keys())


def data(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    X = rng.uniform(-1.0, 1.0, size=(n, D))
    return X, np.sin(3.0 * X[:, 0]) + X[:, 3] + 0.1 * rng.normal(size=n)


def model(kernel, form, u: int, seed: int = 5, **options) -> InducingGP:
    return InducingGP(kernel, kernel.initial(np.ones(D), 1.2), -1.5, data(u, seed)[0], form, 0.1, **options)


def exact_twin(gp: InducingGP) -> ExactGP:
    return ExactGP(gp.kernel, gp.theta, gp.log_noise, gp.noise_floor)


@pytest.mark.parametrize(
    ("form", "objective", "mean", "variance"),
    [
        ("fitc", 2.39214281668917, 0.960938912332824, 0.0154167478394909),
        ("vfe", 4.16850313704433, 0.975943864416824, 0.0130341832743398),
    ],
)
def test_golden_numbers(form, objective, mean, variance) -> None:
    """Five points of sin 3x, three inducing inputs, against numbers computed with 50 digits."""
    X = np.linspace(0.0, 1.0, 5)[:, None]
    theta, Z = np.log([np.sqrt(1.5), 0.5]), np.array([[0.0], [0.5], [1.0]])
    gp = InducingGP(SquaredExponential((0,)), theta, 0.5 * np.log(0.01), Z, form, jitter=0.0)
    assert -gp.log_marginal_likelihood(X, np.sin(3.0 * X[:, 0]))[0] == pytest.approx(objective, rel=1e-12)
    m, v = gp.condition(X, np.sin(3.0 * X[:, 0])).predict(np.array([[0.6]]))
    assert m[0] == pytest.approx(mean, rel=1e-12)
    assert v[0] == pytest.approx(variance, rel=1e-12)


@FORMS
@BOTH
def test_the_formulas_written_out(kernel, form) -> None:
    (X, y), (T, _) = data(40), data(6, 2)
    gp = model(kernel, form, 7)
    K_uu = kernel.value(gp.theta, gp.Z, gp.Z)
    K_uu += gp.jitter * K_uu.diagonal().mean() * np.eye(7)
    K_uf, K_ut = kernel.value(gp.theta, gp.Z, X), kernel.value(gp.theta, gp.Z, T)
    Q = K_uf.T @ np.linalg.solve(K_uu, K_uf)
    missing = kernel.diagonal(gp.theta, X) - Q.diagonal()
    noises = gp.noise_variance + (missing if form == "fitc" else 0.0 * missing)
    S = Q + np.diag(noises)
    value = -0.5 * (y @ np.linalg.solve(S, y) + np.linalg.slogdet(2.0 * np.pi * S)[1])
    value -= 0.5 * missing.sum() / gp.noise_variance if form == "vfe" else 0.0
    assert gp.log_marginal_likelihood(X, y)[0] == pytest.approx(value, rel=1e-10)
    B = K_uu + (K_uf / noises) @ K_uf.T
    mean = K_ut.T @ np.linalg.solve(B, K_uf @ (y / noises))
    covariance = kernel.value(gp.theta, T, T) - K_ut.T @ (np.linalg.inv(K_uu) - np.linalg.inv(B)) @ K_ut
    posterior = gp.condition(X, y)
    np.testing.assert_allclose(posterior.predict(T)[0], mean, atol=1e-9)
    np.testing.assert_allclose(posterior.mean(T), mean, atol=1e-9)
    np.testing.assert_allclose(posterior.covariance(T, T), covariance, atol=1e-9)


@pytest.mark.thinned
@FORMS
@BOTH
@pytest.mark.parametrize("jitter", [0.0, 1e-8, 1e-2])
def test_gradient_in_hyperparameters_and_inducing_inputs(kernel, form, jitter) -> None:
    X, y = data(150)
    gp = model(kernel, form, 5, jitter=jitter)
    _, gradient = gp.log_marginal_likelihood(X, y)
    assert gradient.shape == gp.parameters.shape == (kernel.size + 1 + 5 * D,)
    for i in range(len(gradient)):
        step = np.zeros(len(gradient))
        step[i] = 1e-5
        ends = [
            gp.with_parameters(gp.parameters + s * step).log_marginal_likelihood(X, y)[0] for s in (1, -1)
        ]
        assert gradient[i] == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-6, abs=1e-5)


@FORMS
@BOTH
def test_all_samples_as_inducing_inputs_are_exact_regression(kernel, form) -> None:
    (X, y), (T, _) = data(30), data(9, 2)
    gp = replace(model(kernel, form, 1, jitter=0.0), Z=X)
    exact = exact_twin(gp)
    assert gp.log_marginal_likelihood(X, y)[0] == pytest.approx(
        exact.log_marginal_likelihood(X, y)[0], rel=1e-8
    )
    sparse, full = gp.condition(X, y), exact.condition(X, y)
    for ours, theirs in zip(sparse.predict(T), full.predict(T), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-8)
    np.testing.assert_allclose(sparse.covariance(T, X), full.covariance(T, X), atol=1e-8)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), u=st.integers(1, 25), log_noise=st.floats(-4.0, 1.0))
def test_the_bound_is_below_the_exact_likelihood_and_rises_with_each_inducing_input(
    seed, u, log_noise
) -> None:
    X, y = data(25, seed)
    gp = replace(model(KERNELS["ard"], "vfe", u, seed + 1), log_noise=log_noise)
    bound = gp.log_marginal_likelihood(X, y)[0]
    assert bound <= exact_twin(gp).log_marginal_likelihood(X, y)[0] + 1e-9 * abs(bound)
    more = replace(gp, Z=np.vstack([gp.Z, data(1, seed + 2)[0]]))
    assert more.log_marginal_likelihood(X, y)[0] >= bound - 1e-9 * abs(bound)


def test_fitc_is_no_bound() -> None:
    """Its likelihood can exceed the exact one, which is why vfe is the default."""
    rng = np.random.default_rng(0)
    X = np.linspace(0.0, 3.0, 40)[:, None]
    y = np.where(X[:, 0] < 1.5, 0.0, rng.normal(size=40))  # noise that grows: FITC's extra noise can say so
    gp = InducingGP(SquaredExponential((0,)), np.log([1.0, 0.2]), -4.0, np.array([[0.1], [0.7]]), "fitc")
    assert gp.log_marginal_likelihood(X, y)[0] > exact_twin(gp).log_marginal_likelihood(X, y)[0]
    assert replace(gp, form="vfe").log_marginal_likelihood(X, y)[0] < gp.log_marginal_likelihood(X, y)[0]


@FORMS
def test_order_of_samples_and_of_inducing_inputs_changes_nothing(form) -> None:
    (X, y), (T, _) = data(40), data(5, 3)
    gp = model(KERNELS["structured"], form, 6)
    back = replace(gp, Z=gp.Z[::-1])
    value, gradient = gp.log_marginal_likelihood(X, y)
    other, turned = back.log_marginal_likelihood(X[::-1], y[::-1])
    assert other == pytest.approx(value, rel=1e-9)
    P = gp.kernel.size + 1
    np.testing.assert_allclose(turned[:P], gradient[:P], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(
        turned[P:].reshape(6, D)[::-1], gradient[P:].reshape(6, D), rtol=1e-6, atol=1e-6
    )
    for ours, theirs in zip(
        back.condition(X[::-1], y[::-1]).predict(T), gp.condition(X, y).predict(T), strict=True
    ):
        np.testing.assert_allclose(ours, theirs, atol=1e-9)


@FORMS
def test_far_from_the_inducing_inputs_the_prior_returns(form) -> None:
    X, y = data(60)
    posterior = model(KERNELS["ard"], form, 10).condition(X, y)
    mean, variance = posterior.predict(np.full((1, D), 50.0))
    assert mean[0] == pytest.approx(0.0, abs=1e-12)
    assert variance[0] == pytest.approx(1.2**2, rel=1e-9)
    assert posterior.signal_variance == pytest.approx(1.2**2, rel=1e-9)


@FORMS
@pytest.mark.parametrize(
    "spoil",
    [
        lambda X, y: (X, 0.0 * y),
        lambda X, y: (np.repeat(X[:3], 10, axis=0), np.repeat(y[:3], 10)),
        lambda X, y: (X[:1], y[:1]),
        lambda X, y: (X[:4], y[:4]),
        lambda X, y: (X, 1e6 * y),
    ],
    ids=["constant outputs", "repeated rows", "one sample", "fewer samples than inputs", "huge outputs"],
)
@pytest.mark.filterwarnings("ignore::etude.models.gp.cholesky.JitterWarning")
def test_poor_data_give_finite_numbers(form, spoil) -> None:
    X, y = spoil(*data(30))
    gp = model(KERNELS["ard"], form, 12)
    value, gradient = gp.log_marginal_likelihood(X, y)
    mean, variance = gp.condition(X, y).predict(data(20, 9)[0])
    for number in (value, gradient, mean, variance):
        assert np.isfinite(number).all()
    assert (variance >= 0.0).all()


@FORMS
def test_repeated_inducing_inputs_count_once(form) -> None:
    (X, y), (T, _) = data(40), data(5, 3)
    gp = model(KERNELS["ard"], form, 6)
    twice = replace(gp, Z=np.repeat(gp.Z, 2, axis=0))
    # each carries half the jitter's effect, so equal up to the jitter
    for ours, theirs in zip(twice.condition(X, y).predict(T), gp.condition(X, y).predict(T), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-6)
    with pytest.warns(JitterWarning, match="added"):
        replace(twice, jitter=0.0).condition(X, y)


@FORMS
def test_units_change_nothing(form) -> None:
    (X, y), (T, _) = data(40), data(5, 1)
    kernel, scales = KERNELS["ard"], np.log(np.array([255.0, *[1e6] * D]))
    plain = model(kernel, form, 6)
    other = replace(
        plain,
        theta=plain.theta + scales,
        Z=plain.Z * 1e6,
        log_noise=plain.log_noise + np.log(255.0),
        noise_floor=25.5,
    )
    (m, v), (mo, vo) = (
        plain.condition(X, y).predict(T),
        other.condition(X * 1e6, y * 255.0).predict(T * 1e6),
    )
    np.testing.assert_allclose(mo / 255.0, m, rtol=1e-7)
    np.testing.assert_allclose(vo / 255.0**2, v, rtol=1e-7)


@FORMS
def test_bad_input_is_named(form) -> None:
    X, y = data(10)
    gp = model(KERNELS["ard"], form, 3)
    with pytest.raises(NumericalError, match="too little for an inducing-point model"):
        replace(gp, log_noise=-20.0, noise_floor=0.0).log_marginal_likelihood(X, y)
    with pytest.raises(NumericalError, match="Set a noise floor"):
        replace(gp, log_noise=-500.0, noise_floor=0.0).condition(X, y)
    with pytest.raises(DataError, match="NaN or infinite"):
        gp.condition(X, np.full(10, np.nan))
    with pytest.raises(UsageError, match="inputs have 7 columns, the inducing inputs 8"):
        gp.condition(X[:, :7], y)
    with pytest.raises(UsageError, match=r"expected inputs of shape \(T, 8\)"):
        gp.condition(X, y).predict(X[:, :7])
    with pytest.raises(UsageError, match="24 coordinates of inducing inputs"):
        gp.with_parameters(gp.parameters[:-1])
    with pytest.raises(UsageError, match="hyperparameters, the vector has shape"):
        replace(gp, theta=np.zeros(3))
    with pytest.raises(UsageError, match="log_noise"):
        replace(gp, log_noise=np.nan)
    with pytest.raises(UsageError, match="jitter"):
        replace(gp, jitter=-1.0)
    with pytest.raises(UsageError, match="unknown form"):
        replace(gp, form="sor")
    for Z in (np.zeros(8), np.zeros((0, 8)), np.full((2, 8), np.nan)):
        with pytest.raises(UsageError, match="inducing inputs must be a finite array"):
            replace(gp, Z=Z)
