"""Every design criterion on the posteriors that rest on basis points: FITC, VFE, sparse online process."""

from __future__ import annotations

import numpy as np
import pytest
from arm_kernel import structured_kernel

from etude import plugins
from etude.design import Output, PlainBatch, criterion_named, evaluate, value_of
from etude.models import BasisPosterior, InducingGP, Kernel, SquaredExponential
from etude_sparse import SOGP

CRITERIA = list(plugins.BUILT_IN["etude.criteria"])

D = 8


def inputs(n: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (n, D))


def inducing(kernel: Kernel, form) -> BasisPosterior:
    X = inputs(40, 0)
    gp = InducingGP(kernel, kernel.initial(np.ones(D), 1.2), -1.5, inputs(9, 1), form)
    return gp.condition(X, np.sin(2.0 * X[:, 0]))


def online(deletion) -> BasisPosterior:
    X, kernel = inputs(40, 0), SquaredExponential(tuple(range(D)))
    prior = SOGP(kernel, kernel.initial(np.ones(D), 1.2), -1.5, capacity=12, deletion=deletion)
    return prior.condition(X, np.sin(2.0 * X[:, 0]))


POSTERIORS = {
    "fitc": lambda: inducing(SquaredExponential(tuple(range(D))), "fitc"),
    "vfe": lambda: inducing(structured_kernel(2, 0), "vfe"),
    "online, A": lambda: online("A"),
    "online, B": lambda: online("B"),
}


@pytest.fixture(scope="module", params=POSTERIORS.values(), ids=POSTERIORS.keys())
def posterior(request: pytest.FixtureRequest) -> BasisPosterior:
    """Not made while files are collected, which each worker does."""
    return request.param()


@pytest.mark.parametrize("name", CRITERIA)
def test_gradient_and_shared_factors(name, posterior, monkeypatch) -> None:
    Z, R, gains = inputs(4, 2), inputs(5, 3), np.random.default_rng(4).uniform(0.5, 1.0, (4, 1))
    outputs = [Output.of(posterior, R)]
    value, in_Z, _ = evaluate(criterion_named(name), outputs, Z, gains)
    assert value == pytest.approx(value_of(criterion_named(name), outputs, Z, gains), rel=1e-12)
    for index in np.ndindex(Z.shape):
        step = np.zeros_like(Z)
        step[index] = 1e-4
        ends = [value_of(criterion_named(name), outputs, Z + s * step, gains) for s in (1, -1)]
        assert in_Z[index] == pytest.approx((ends[0] - ends[1]) / 2e-4, rel=1e-6, abs=1e-7)
    monkeypatch.setattr("etude.design.criteria.batch_of", PlainBatch)
    plain, plain_in_Z, _ = evaluate(criterion_named(name), [Output.of(posterior, R)], Z, gains)
    assert plain == pytest.approx(value, rel=1e-9)
    np.testing.assert_allclose(plain_in_Z, in_Z, rtol=1e-7, atol=1e-9)
