"""The deep Lagrangian network: Lagrange's equations, its gradient, and a pendulum that it learns."""

from __future__ import annotations

import numpy as np
import pytest

from etude.types import Array
from etude_studies.thesis.lagrangian_network import (
    LEAST_INERTIA,
    Motion,
    forces,
    lagrangian_network,
    loss_gradient,
    outputs,
)
from etude_studies.thesis.regressors import NetworkSetting, Weights, first_weights, layers

J, N, F = 3, 5, 4
STEP = 1e-5


def drawn(seed: int) -> tuple[Weights, Array, Motion]:
    rng = np.random.default_rng(seed)
    first = first_weights((J, 6, 5, outputs(J)), rng)
    weights: Weights = [(W.astype(float), b + 0.1 * rng.normal(size=b.shape)) for W, b in first]
    return weights, rng.normal(size=(J, F)), Motion(*rng.normal(size=(3, N, J)), rng.normal(size=(N, J, F)))


def energies(weights: Weights, q: Array) -> tuple[Array, Array]:
    """Inertia (n, J, J) and potential energy (n,), from the outputs alone."""
    values = layers(weights, q)[-1]
    L = np.zeros((len(q), J, J))
    L[:, *np.tril_indices(J)] = values[:, :-1]
    return L @ L.transpose(0, 2, 1) + LEAST_INERTIA * np.eye(J), values[:, -1]


def test_forces_are_those_of_lagranges_equations() -> None:
    """d/dt (dT/dqd) - d(T - V)/dq by differences of the energies."""
    weights, friction, motion = drawn(0)
    q, qd, qdd = motion.q, motion.qd, motion.qdd

    def momentum(sign: float) -> Array:
        H, _ = energies(weights, q + sign * STEP * qd)
        return np.einsum("nab,nb->na", H, qd + sign * STEP * qdd)

    def lagrangian(q: Array) -> Array:
        H, V = energies(weights, q)
        return 0.5 * np.einsum("na,nab,nb->n", qd, H, qd) - V

    expected = (momentum(1.0) - momentum(-1.0)) / (2.0 * STEP)
    for i, step in enumerate(STEP * np.eye(J)):
        expected[:, i] -= (lagrangian(q + step) - lagrangian(q - step)) / (2.0 * STEP)
    assert forces(weights, 0.0 * friction, motion) == pytest.approx(expected, abs=1e-8)  # of differences
    rest = np.einsum("njf,jf->nj", motion.friction, friction)
    assert forces(weights, friction, motion) == pytest.approx(expected + rest, abs=1e-8)


def test_the_gradient_is_that_of_the_loss() -> None:
    weights, friction, motion = drawn(1)
    target, spread = np.random.default_rng(2).normal(size=(N, J)), np.array([1.0, 2.0, 0.5])
    _, gradient = loss_gradient(weights, friction, motion, target, spread, 0.1)
    values = [*(part for layer in weights for part in layer), friction]
    assert len(gradient) == len(values)
    for value, slope in zip(values, gradient, strict=True):
        for place in np.ndindex(value.shape):
            ends = []
            for sign in (STEP, -STEP):
                value[place] += sign
                ends.append(loss_gradient(weights, friction, motion, target, spread, 0.1)[0])
                value[place] -= sign
            assert slope[place] == pytest.approx((ends[0] - ends[1]) / (2.0 * STEP), abs=1e-7)


def test_it_learns_a_pendulum_in_other_units_and_where_no_sample_was() -> None:
    """tau = 2 qdd + 5 sin q + 0.3 qd + 0.4 sign(qd), learned slowly, is right at five times the speed."""
    rng = np.random.default_rng(3)

    def states(speed: float, count: int) -> Array:
        q, qd, qdd = rng.uniform(-1.5, 1.5, count), speed * rng.normal(size=count), rng.normal(size=count)
        return np.column_stack([q, qd, qdd, np.tanh(qd / 1e-3)])

    def commands(X: Array) -> Array:
        return (2.0 * X[:, 2] + 5.0 * np.sin(X[:, 0]) + 0.3 * X[:, 1] + 0.4 * X[:, 3])[:, None]

    X, new = states(0.2, 1500), states(1.0, 300)
    predict = lagrangian_network(NetworkSetting(16, 0.01, 0.0), X, commands(X), rng)
    # inertia does not depend on the speed, and no term of the plain network would say so
    assert np.sqrt(np.mean((predict(new) - commands(new)) ** 2)) < 0.05 * commands(new).std()
