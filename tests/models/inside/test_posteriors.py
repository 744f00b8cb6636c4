"""What every posterior owes. A new model is a row in MODELS: inputs, outputs -> posterior.

One that has no covariance between inputs is a row in POINTWISE instead.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from etude.errors import UsageError
from etude.models import BayesianLinear, ExactGP, Form, InducingGP, Kernel, SquaredExponential, structured
from etude.models.gp.shared_exact import condition_shared
from etude.protocols import Posterior
from etude_lagrangian import gip_lin
from etude_sparse import (
    LWPR,
    SOGP,
    DictionaryConfig,
    DictionaryGP,
    DownsampledGP,
    IncrementalSpectrum,
    LocalGP,
    SparseSpectrumGP,
)

D = 8
COLUMNS = [
    (channel, part, "", op)
    for channel, op in (("q", ""), ("qd", ""), ("qdd", ""), ("qd", "tanh"))
    for part in "ab"
]
STRUCTURED = structured(COLUMNS, ("a",))


def exact(kernel: Kernel) -> Callable[[np.ndarray, np.ndarray], Posterior]:
    def condition(X: np.ndarray, y: np.ndarray) -> Posterior:
        theta = kernel.initial(np.ones(D), 1.5)
        return ExactGP(kernel, theta, np.log(0.05), noise_floor=0.1).condition(X, y)

    return condition


def shared(X: np.ndarray, y: np.ndarray) -> Posterior:
    return condition_shared(SE, X, np.column_stack([y[::-1], y])).outputs[1]


def inducing(kernel: Kernel, form: Form) -> Callable[[np.ndarray, np.ndarray], Posterior]:
    def condition(X: np.ndarray, y: np.ndarray) -> Posterior:
        Z = np.random.default_rng(1).uniform(-1.0, 1.0, size=(12, D))
        return InducingGP(kernel, kernel.initial(np.ones(D), 1.5), np.log(0.05), Z, form, 0.1).condition(X, y)

    return condition


SPECTRUM = SparseSpectrumGP(
    np.random.default_rng(2).standard_normal((15, D)),
    np.log([1.5, *[1.0] * D]),
    np.log(0.05),
    noise_floor=0.1,
)


def online(X: np.ndarray, y: np.ndarray) -> Posterior:
    model = IncrementalSpectrum.start(SPECTRUM)
    for x, value in zip(X, y, strict=True):
        model.update(x, value)
    return model.posterior


class Waves:
    """phi(x) = (x, sin 2x): the features of the linear regression."""

    def transform(self, X: np.ndarray) -> np.ndarray:
        return np.concatenate([X, np.sin(2.0 * X)], axis=1)

    def pullback(self, X: np.ndarray, G: np.ndarray) -> np.ndarray:
        return G[:, :D] + 2.0 * np.cos(2.0 * X) * G[:, D:]


SE = ExactGP(SquaredExponential(tuple(range(D))), np.log([1.5, *[1.0] * D]), np.log(0.05), noise_floor=0.1)
MODELS = {
    "exact, squared exponential": exact(SquaredExponential(tuple(range(D)))),
    "exact, structured": exact(STRUCTURED),
    "exact, lagrangian and friction": exact(gip_lin(COLUMNS, ("b",))),
    "exact, one kernel for two outputs": shared,
    "linear regression": BayesianLinear(Waves(), np.log(0.5), np.log(0.1)).condition,
    "inducing, fitc": inducing(SquaredExponential(tuple(range(D))), "fitc"),
    "inducing, vfe, structured": inducing(STRUCTURED, "vfe"),
    # deleting a basis point may raise the variance, so the rows have room; the second projects samples
    "sparse online": SOGP(SE.kernel, SE.theta, SE.log_noise, 0.1, capacity=64).condition,
    "sparse online, projecting": SOGP(SE.kernel, SE.theta, SE.log_noise, 0.1, tolerance=0.5).condition,
    "downsampled": DownsampledGP(SE, every=3).condition,
    # what a full dictionary drops may have told more about one place, so the row has room for all points
    "dictionary": DictionaryGP(SE, DictionaryConfig(size=64)).condition,
    "sparse spectrum": SPECTRUM.condition,
    "sparse spectrum, on line": online,
}
# members that their papers give no covariance between inputs: what they owe of the rest
POINTWISE = {
    "local processes": LocalGP(SE, capacity=8).condition,
    "local processes, one": LocalGP(SE, capacity=64).condition,
    "local processes, nearest two": LocalGP(SE, capacity=8, nearest=2).condition,
    "receptive fields": LWPR(metric=0.5, generate=0.3).condition,
    "receptive fields, full metric": LWPR(metric=0.5, full=True).condition,
}
POINTWISE_ROWS = pytest.mark.parametrize("model", POINTWISE.values(), ids=POINTWISE.keys())
EVERY = {**MODELS, **POINTWISE}
EVERY_ROW = pytest.mark.parametrize("model", EVERY.values(), ids=EVERY.keys())
ROWS = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS.keys())


def data(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    X = rng.uniform(-1.0, 1.0, size=(n, D))
    y = np.sin(2.0 * X[:, 0]) + X[:, 3] * X[:, 1] + 0.05 * rng.normal(size=n)
    return X, y - y.mean()


def central(function, at: np.ndarray, step: float = 1e-5) -> np.ndarray:
    out = np.empty_like(at)
    for index in np.ndindex(at.shape):
        shift = np.zeros_like(at)
        shift[index] = step
        out[index] = (function(at + shift) - function(at - shift)) / (2.0 * step)
    return out


@ROWS
def test_variance_is_the_diagonal_of_the_covariance(model) -> None:
    posterior, (Z, _) = model(*data(30)), data(9, 1)
    _, variance = posterior.predict(Z)
    np.testing.assert_allclose(posterior.covariance(Z, Z).diagonal(), variance, rtol=1e-9, atol=1e-12)
    assert np.linalg.eigvalsh(posterior.covariance(Z, Z)).min() > -1e-9
    assert posterior.noise_variance > 0.0
    assert posterior.signal_variance > variance.min()


@ROWS
def test_more_data_never_raises_the_variance(model) -> None:
    X, y = data(40)
    Z, _ = data(50, 2)
    half, full = model(X[:20], y[:20]), model(X, y)
    assert np.all(full.predict(Z)[1] <= half.predict(Z)[1] + 1e-10)


@EVERY_ROW
def test_mean_gradient(model) -> None:
    posterior, (Z, _) = model(*data(60)), data(6, 3)
    expected = central(lambda z: float(posterior.predict(z)[0].sum()), Z)
    np.testing.assert_allclose(posterior.mean_gradient(Z), expected, rtol=1e-6, atol=1e-8)


@EVERY_ROW
def test_variance_gradient(model) -> None:
    posterior, (Z, _) = model(*data(60)), data(6, 4)
    g = np.random.default_rng(5).normal(size=6)
    expected = central(lambda z: float(g @ posterior.predict(z)[1]), Z)
    np.testing.assert_allclose(posterior.variance_gradient(Z, g), expected, rtol=1e-6, atol=1e-8)


@ROWS
def test_covariance_gradient(model) -> None:
    posterior, (Z, _), (R, _) = model(*data(30)), data(6, 6), data(5, 7)
    G = np.random.default_rng(8).normal(size=(6, 5))
    expected = central(lambda z: float(np.sum(G * posterior.covariance(z, R))), Z)
    np.testing.assert_allclose(posterior.covariance_gradient(Z, R, G), expected, rtol=1e-6, atol=1e-8)


@ROWS
def test_the_variance_does_not_depend_on_the_outputs(model) -> None:
    X, y = data(25)
    Z, _ = data(7, 9)
    np.testing.assert_array_equal(model(X, y).predict(Z)[1], model(X, -3.0 * y).predict(Z)[1])


@POINTWISE_ROWS
def test_without_covariances_the_variances_stand_alone_and_a_covariance_is_refused(model) -> None:
    posterior, (Z, _) = model(*data(60)), data(9, 1)
    mean, variance = posterior.predict(Z)
    assert mean.shape == variance.shape == (9,)
    assert np.all(variance > 0.0)
    assert np.all(variance <= posterior.signal_variance * (1.0 + 1e-9))
    assert posterior.noise_variance > 0.0
    with pytest.raises(UsageError, match="no covariance between two inputs"):
        posterior.covariance(Z, Z)
    with pytest.raises(UsageError, match="Design with an exact process"):
        posterior.covariance_gradient(Z, Z, np.eye(9))
    with pytest.raises(UsageError, match="expected inputs"):
        posterior.predict(Z[:, :3])
