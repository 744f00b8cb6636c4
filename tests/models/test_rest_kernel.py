"""Noise at rest as a kernel: its own conformance, since it shares nothing between samples."""

from __future__ import annotations

import numpy as np
import pytest

from etude.errors import UsageError
from etude.models.forms import kernel_of, kernel_words
from etude.models.gp.exact import ExactGP
from etude.models.gp.kernels import SquaredExponential, structured
from etude.models.gp.point_kernel import PointCovariances
from etude.models.gp.rest import RestNoise, standing

COLUMNS = [
    (channel, part, "", op)
    for channel, op in (("q", ""), ("qd", ""), ("qdd", ""), ("qd", "tanh"), ("qd", "memory"), ("qd", "rest"))
    for part in "ab"
]
KERNEL, THETA = RestNoise(1), np.array([0.4])
X = np.abs(np.random.default_rng(0).normal(size=(6, 2)))


def test_it_is_on_the_diagonal_alone() -> None:
    K, pull = KERNEL.gram(THETA, X)
    expected = np.exp(0.8) * X[:, 1] ** 2
    np.testing.assert_allclose(K, np.diag(expected))
    np.testing.assert_allclose(KERNEL.diagonal(THETA, X), expected)
    np.testing.assert_array_equal(KERNEL.value(THETA, X, X), 0.0)
    G = np.random.default_rng(1).normal(size=(6, 6))
    step = 1e-6
    ends = [np.sum(G * KERNEL.gram(THETA + s, X)[0]) for s in (step, -step)]
    np.testing.assert_allclose(pull(G), (ends[0] - ends[1]) / (2.0 * step), rtol=1e-7)
    g, bent = G[0], X.copy()
    bent[2, 1] += step
    slope = (g @ (KERNEL.diagonal(THETA, bent) - KERNEL.diagonal(THETA, X))) / step
    np.testing.assert_allclose(KERNEL.diagonal_gradient(THETA, X, g)[2, 1], slope, rtol=1e-4)


def test_a_sample_at_rest_counts_less() -> None:
    """Two samples of one input: the moving one says nearly all."""
    at, y = np.array([[0.0, 0.0], [0.0, 1.0]]), np.array([1.0, 5.0])
    gp = ExactGP(SquaredExponential((0,)) + KERNEL, np.array([1.0, 0.0, np.log(10.0)]), np.log(0.1))
    assert gp.condition(at, y).predict(at[:1])[0][0] == pytest.approx(1.0, abs=0.02)
    plain = ExactGP(SquaredExponential((0,)), np.array([1.0, 0.0]), np.log(0.1))
    assert plain.condition(at, y).predict(at[:1])[0][0] == pytest.approx(3.0, abs=0.02)


def test_the_standing_kernel_adds_memory_to_the_structured_one_and_is_stored() -> None:
    kernel, plain = standing(COLUMNS, ("b",)), structured(COLUMNS, ("b",))
    assert structured(COLUMNS[:8], ("b",)) == plain  # which does not look at it
    assert kernel_of(kernel_words(kernel)) == kernel
    assert kernel.size == plain.size + 5
    theta, Z = (
        np.random.default_rng(2).normal(size=kernel.size) * 0.3,
        np.abs(np.random.default_rng(3).normal(size=(5, 12))),
    )
    np.testing.assert_allclose(PointCovariances(kernel, theta, 12)(Z[0], Z), kernel.value(theta, Z[:1], Z)[0])
    with pytest.raises(UsageError, match="what friction remembers"):
        standing(COLUMNS[:8], ("b",))
