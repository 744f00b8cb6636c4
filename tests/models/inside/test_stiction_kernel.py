"""Noise at rest as a kernel: its own conformance, since it shares nothing between samples."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from etude.errors import UsageError
from etude.models import (
    ExactGP,
    LearnedModel,
    Posteriors,
    SquaredExponential,
    kernel_metadata,
    kernel_of,
    structured,
)
from etude.models.gp.kernels import RestNoise, standing
from etude.models.gp.single_point import PointCovariances
from etude.models.process_abilities import EnsembleMember
from etude.types import Log

COLUMNS = [
    (channel, part, "", op)
    for channel, op in (("q", ""), ("qd", ""), ("qdd", ""), ("qd", "tanh"), ("qd", "memory"), ("qd", "rest"))
    for part in "ab"
]
KERNEL, THETA = RestNoise(1), np.array([0.4])
X = np.abs(np.random.default_rng(0).normal(size=(6, 2)))


def test_it_is_on_the_diagonal_alone() -> None:
    K, vjp = KERNEL.gram(THETA, X)
    expected = np.exp(0.8) * X[:, 1] ** 2
    np.testing.assert_allclose(K, np.diag(expected))
    np.testing.assert_allclose(KERNEL.diagonal(THETA, X), expected)
    np.testing.assert_array_equal(KERNEL.value(THETA, X, X), 0.0)
    G = np.random.default_rng(1).normal(size=(6, 6))
    step = 1e-6
    ends = [np.sum(G * KERNEL.gram(THETA + s, X)[0]) for s in (step, -step)]
    np.testing.assert_allclose(vjp(G), (ends[0] - ends[1]) / (2.0 * step), rtol=1e-7)
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
    assert kernel_of(kernel_metadata(kernel)) == kernel
    assert kernel.size == plain.size + 5
    theta, Z = (
        np.random.default_rng(2).normal(size=kernel.size) * 0.3,
        np.abs(np.random.default_rng(3).normal(size=(5, 12))),
    )
    np.testing.assert_allclose(PointCovariances(kernel, theta, 12)(Z[0], Z), kernel.value(theta, Z[:1], Z)[0])
    with pytest.raises(UsageError, match="the memory of friction"):
        standing(COLUMNS[:8], ("b",))


def test_no_noise_makes_a_known_command_fade() -> None:
    """Neither a sensor's nor what friction holds at rest, though each is far above what was to be learned."""
    rng = np.random.default_rng(4)
    at = np.column_stack([rng.uniform(-1.0, 1.0, 400), np.repeat([0.0, 1.0], 200)])
    y = np.sin(at[:, 0]) + rng.normal(size=400) * np.where(at[:, 1] > 0.0, 20.0, 2.0)
    gp = ExactGP(SquaredExponential((0,)) + KERNEL, np.array([0.0, 0.0, np.log(20.0)]), np.log(2.0))
    own, one = Posteriors((gp.condition(at, y),)), np.ones(1)
    candidate = EnsembleMember("gp", (0,), one, None, own, np.array([[0.0], [3.0]]), 1.5 * one)
    model = LearnedModel(cast("Any", Plain()), (candidate,), ("a",), np.zeros((2, 2)), True, one)
    states = {"q": np.array([[0.3], [0.3], [9.0], [9.0]]), "rest": np.array([[0.0], [1.0], [0.0], [1.0]])}
    (mean, variance), (faded, same) = model.posterior(states), model.predict(states)
    np.testing.assert_array_equal(variance, same)
    assert variance[1, 0] - variance[0, 0] == pytest.approx(1.5 * 9.0 * 400.0, rel=1e-6)
    assert mean[0, 0] > 0.3
    np.testing.assert_allclose(faded[:, 0], [mean[0, 0], mean[1, 0], 0.0, 0.0], rtol=0.0, atol=1e-9)
    np.testing.assert_array_equal(replace(model, least=one).predict(states)[0], 0.0)


class Plain:
    """Inputs that are a position and how much a joint rests."""

    columns = (("q", "a", "rad", ""), ("rest", "a", "", ""))

    def of_log(self, log: Log) -> np.ndarray:
        return np.column_stack([log["q"], log["rest"]])
