"""What every kernel owes. A new kernel is a row in KERNELS."""

from __future__ import annotations

import numpy as np
import pytest

from etude.errors import UsageError
from etude.models import Kernel, Linear, SquaredExponential, structured
from etude_lagrangian import Joints, Lagrangian, gip_lin

D = 8
COLUMNS = [
    (channel, part, "", op)
    for channel, op in (("q", ""), ("qd", ""), ("qdd", ""), ("qd", "tanh"))
    for part in "ab"
]
KERNELS: dict[str, Kernel] = {
    "squared exponential": SquaredExponential(tuple(range(D))),
    "on scattered columns": SquaredExponential((1, 4, 2)),
    "unit amplitude": SquaredExponential((0, 3), unit=True),
    "linear": Linear((2, 3, 7)),
    "sum": SquaredExponential((0, 1)) + Linear((2,)),
    "product": Linear((5,)) * SquaredExponential((0, 1), unit=True),
    "product of three": Linear((5,)) * SquaredExponential((0, 1)) * (Linear((1, 2)) + Linear((3,))),
    "structured": structured(COLUMNS, ("b",)),
    "lagrangian": Lagrangian(Joints((0, 1), (2, 3), (4, 5), (False, False)), 0),
    "lagrangian with a slide": Lagrangian(Joints((3, 1), (2, 0), (6, 5), (True, False)), 1),
    "lagrangian and friction": gip_lin(COLUMNS, ("b",)),
}
ROWS = pytest.mark.parametrize("kernel", KERNELS.values(), ids=KERNELS.keys())


def inputs(n: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(n, D)) * np.linspace(0.5, 2.0, D)


def theta_of(kernel: Kernel) -> np.ndarray:
    return np.random.default_rng(kernel.size).normal(size=kernel.size) * 0.5


def central(function, at: np.ndarray, step: float = 1e-6) -> np.ndarray:
    out = np.empty_like(at)
    for index in np.ndindex(at.shape):
        shift = np.zeros_like(at)
        shift[index] = step
        out[index] = (function(at + shift) - function(at - shift)) / (2.0 * step)
    return out


@ROWS
def test_names_roles_and_start_have_the_length_of_theta(kernel: Kernel) -> None:
    start = kernel.initial(np.linspace(0.5, 2.0, D), 3.0)
    assert len(set(kernel.names())) == kernel.size == len(kernel.roles()) == len(start)
    assert np.isfinite(start).all()


@ROWS
def test_gram_cross_and_diagonal_agree(kernel: Kernel) -> None:
    X, theta = inputs(9, 0), theta_of(kernel)
    K = kernel.gram(theta, X)[0]
    assert K.flags.f_contiguous
    np.testing.assert_allclose(kernel.value(theta, X, X), K, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(K.diagonal(), kernel.diagonal(theta, X), rtol=1e-12)
    np.testing.assert_allclose(K, K.T, rtol=1e-12, atol=1e-14)
    Z = inputs(4, 1)
    np.testing.assert_allclose(kernel.value(theta, X, Z), kernel.value(theta, Z, X).T, rtol=1e-12, atol=1e-14)


@ROWS
def test_weighted_sums_are_those_of_the_matrix(kernel: Kernel) -> None:
    X, Z, theta = inputs(7, 3), inputs(5, 4), theta_of(kernel)
    matrix = kernel.value(theta, X, Z)
    for alpha in (np.linspace(-1.0, 2.0, 5), np.linspace(-2.0, 1.0, 10).reshape(5, 2)):
        found = kernel.sums(theta, Z, alpha)(X)
        np.testing.assert_allclose(found, matrix @ alpha, atol=1e-12 * np.abs(matrix).max())


@ROWS
def test_positive_semidefinite(kernel: Kernel) -> None:
    K = kernel.gram(theta_of(kernel), inputs(40, 2))[0]
    assert np.linalg.eigvalsh(K).min() > -1e-10 * K.diagonal().mean()


@ROWS
def test_theta_gradient(kernel: Kernel) -> None:
    X, theta = inputs(7, 3), theta_of(kernel)
    G = np.random.default_rng(4).normal(size=(7, 7))
    expected = central(lambda t: float(np.sum(G * kernel.value(t, X, X))), theta)
    np.testing.assert_allclose(kernel.theta_gradient(theta, X, G), expected, rtol=1e-6, atol=1e-7)
    folded = np.tril(G) + np.triu(G, 1).T
    np.testing.assert_allclose(kernel.theta_gradient(theta, X, folded), expected, rtol=1e-6, atol=1e-7)


@ROWS
@pytest.mark.parametrize("n", [7, 300])
def test_the_lower_half_is_that_of_the_matrix(kernel: Kernel, n: int) -> None:
    X, theta = inputs(n, 3), theta_of(kernel)
    (K, vjp), (lower, pull_lower) = kernel.gram(theta, X), kernel.gram_lower(theta, X)
    np.testing.assert_allclose(np.tril(lower), np.tril(K), rtol=1e-12, atol=1e-14 * np.abs(K).max())
    G = np.asfortranarray(np.tril(np.random.default_rng(4).normal(size=(n, n))))
    expected = vjp(G)
    np.testing.assert_allclose(pull_lower(G), expected, rtol=1e-10, atol=1e-11 * np.abs(expected).max())


@ROWS
def test_input_gradient(kernel: Kernel) -> None:
    X, Z, theta = inputs(6, 5), inputs(5, 6), theta_of(kernel)
    G = np.random.default_rng(7).normal(size=(6, 5))
    expected = central(lambda x: float(np.sum(G * kernel.value(theta, x, Z))), X)
    np.testing.assert_allclose(kernel.input_gradient(theta, X, Z, G), expected, rtol=1e-6, atol=1e-7)


@ROWS
def test_diagonal_gradient(kernel: Kernel) -> None:
    X, theta = inputs(6, 8), theta_of(kernel)
    g = np.random.default_rng(9).normal(size=6)
    expected = central(lambda x: float(g @ kernel.diagonal(theta, x)), X)
    np.testing.assert_allclose(kernel.diagonal_gradient(theta, X, g), expected, rtol=1e-6, atol=1e-7)


@ROWS
def test_pulls_can_be_called_twice(kernel: Kernel) -> None:
    X, theta = inputs(5, 10), theta_of(kernel)
    G = np.random.default_rng(11).normal(size=(5, 5))
    for _, vjp in (kernel.gram(theta, X), kernel.cross(theta, X, X)):
        np.testing.assert_array_equal(vjp(G), vjp(G))


@ROWS
def test_wrong_theta_is_refused(kernel: Kernel) -> None:
    with pytest.raises(UsageError, match=f"has {kernel.size} hyperparameters"):
        kernel.value(np.zeros(kernel.size + 1), inputs(2, 0), inputs(2, 0))
    with pytest.raises(UsageError, match="must be finite"):
        kernel.diagonal(np.full(kernel.size, np.nan), inputs(2, 0))


@ROWS
def test_columns_that_are_not_there_are_refused(kernel: Kernel) -> None:
    with pytest.raises(UsageError, match="needs more than inputs of shape"):
        kernel.value(theta_of(kernel), np.zeros((3, 0)), np.zeros((3, 0)))
