"""The mean at one input: the same as the posteriors' own, whatever the number of points and the scale."""

from __future__ import annotations

import numpy as np
import pytest
from arm_kernel import structured_kernel

from etude.errors import UsageError
from etude.models import ExactGP, ExactPosterior, Linear, PointMean, SquaredExponential
from etude.models.gp.single_point import _exponential
from etude_sparse import DictionaryConfig, DictionaryGP

D = 5


def process(rng: np.random.Generator, scale: float = 1.0) -> ExactGP:
    theta = np.append(rng.normal(), np.log(scale) + rng.normal(scale=0.3, size=D))
    return ExactGP(SquaredExponential(tuple(range(D))), theta, -2.0)


def posterior(rng: np.random.Generator, n: int, scale: float = 1.0, shift: float = 0.0) -> ExactPosterior:
    return process(rng, scale).condition(shift + scale * rng.normal(size=(n, D)), rng.normal(size=n))


@pytest.mark.parametrize(("scale", "shift"), [(1.0, 0.0), (1e6, 0.0), (1e-3, 0.0), (1.0, 100.0)])
def test_equals_the_posteriors_of_different_sizes(scale: float, shift: float) -> None:
    rng = np.random.default_rng(0)
    posteriors = [posterior(rng, n, scale, shift) for n in (40, 1, 25)]
    mean = PointMean(posteriors)
    X = np.vstack([shift + scale * rng.normal(size=(20, D)), posteriors[0].X[:3], posteriors[2].X[-2:]])
    wanted = np.stack([p.predict(X)[0] for p in posteriors], axis=1)
    assert np.allclose([mean(x) for x in X], wanted, rtol=0.0, atol=1e-10 * np.abs(wanted).max())


def test_equals_a_dictionary() -> None:
    rng = np.random.default_rng(1)
    X, y = rng.normal(size=(120, D)), rng.normal(size=120)
    kept = DictionaryGP(process(rng), DictionaryConfig(size=30)).condition(X, y)
    x = rng.normal(size=D)
    assert PointMean([kept])(x) == pytest.approx(kept.predict(x[None])[0], abs=1e-12)


def test_far_away_it_is_the_prior_mean_and_nan_stays_nan() -> None:
    mean = PointMean([posterior(np.random.default_rng(2), 10)] * 2)
    assert np.array_equal(mean(np.full(D, 1e6)), [0.0, 0.0])
    assert np.isnan(mean(np.full(D, np.nan))).all()


def test_bad_input() -> None:
    rng = np.random.default_rng(3)
    good = posterior(rng, 10)
    with pytest.raises(UsageError, match="one at least"):
        PointMean([])
    narrow = ExactGP(SquaredExponential((0,)), np.zeros(2), -1.0).condition(
        rng.normal(size=(4, 1)), np.ones(4)
    )
    with pytest.raises(UsageError, match=r"widths: \[1, 5\]"):
        PointMean([good, narrow])
    crossed = Linear((0,)) * Linear((1,)) * SquaredExponential((2,))
    strange = ExactGP(crossed, np.zeros(crossed.size), -1.0).condition(good.X, good.y)
    with pytest.raises(UsageError, match="not implemented for"):
        PointMean([good, strange])
    with pytest.raises(UsageError, match="one input of shape"):
        PointMean([good])(np.zeros((1, D)))


def test_equals_structured_and_mixed_kernels() -> None:
    """Sums, products, linear parts and inputs left out; outputs with different numbers of terms."""
    rng = np.random.default_rng(4)
    X = rng.normal(size=(60, 10))
    kernels = (
        structured_kernel(2, 1, 2),
        SquaredExponential(tuple(range(10))),
        Linear((3, 7)),
        SquaredExponential((1, 2), unit=True) * SquaredExponential((2, 5)) + Linear((0, 9)),
    )
    posteriors = [
        ExactGP(k, rng.normal(scale=0.4, size=k.size), -1.0).condition(X, rng.normal(size=60))
        for k in kernels
    ]
    mean, at = PointMean(posteriors), np.vstack([rng.normal(size=(20, 10)), X[:4]])
    wanted = np.stack([p.predict(at)[0] for p in posteriors], axis=1)
    assert np.allclose([mean(x) for x in at], wanted, rtol=0.0, atol=1e-10 * np.abs(wanted).max())


def test_the_exponential_is_that_of_numpy() -> None:
    e = np.concatenate([np.linspace(-708.0, 699.0, 20011), np.random.default_rng(5).normal(size=999), [0.0]])
    wanted, bits = np.exp(e), np.empty_like(e)
    _exponential(e, bits, len(e))
    assert np.abs(e / wanted - 1.0).max() <= 5e-16
    edges = np.array([-710.0, -1e300, -np.inf, np.nan])
    _exponential(edges, np.empty(4), 4)
    assert np.array_equal(edges, [0.0, 0.0, 0.0, np.nan], equal_nan=True)


def test_infinite_inputs_have_no_mean() -> None:
    mean = PointMean([posterior(np.random.default_rng(6), 10)])
    assert np.isnan(mean(np.array([np.inf, 0.0, 0.0, 0.0, 0.0]))).all()
