"""The mean at one input: the same as the posteriors' own, whatever the number of points and the scale."""

from __future__ import annotations

import numpy as np
import pytest

from etude.errors import UsageError
from etude.models.gp.dictionary import DictionaryConfig, DictionaryGP
from etude.models.gp.exact import ExactGP, ExactPosterior
from etude.models.gp.kernels import Linear, SquaredExponential
from etude.models.gp.single_point import PointMean

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
    mean = PointMean.of(posteriors)
    X = np.vstack([shift + scale * rng.normal(size=(20, D)), posteriors[0].X[:3], posteriors[2].X[-2:]])
    wanted = np.stack([p.predict(X)[0] for p in posteriors], axis=1)
    assert np.allclose([mean(x) for x in X], wanted, rtol=0.0, atol=1e-10 * np.abs(wanted).max())


def test_equals_a_dictionary() -> None:
    rng = np.random.default_rng(1)
    X, y = rng.normal(size=(120, D)), rng.normal(size=120)
    kept = DictionaryGP(process(rng), DictionaryConfig(size=30)).condition(X, y)
    x = rng.normal(size=D)
    assert PointMean.of([kept])(x) == pytest.approx(kept.predict(x[None])[0], abs=1e-12)


def test_far_away_it_is_the_prior_mean_and_nan_stays_nan() -> None:
    mean = PointMean.of([posterior(np.random.default_rng(2), 10)] * 2)
    assert np.array_equal(mean(np.full(D, 1e6)), [0.0, 0.0])
    assert np.isnan(mean(np.full(D, np.nan))).all()


def test_bad_input() -> None:
    rng = np.random.default_rng(3)
    good = posterior(rng, 10)
    with pytest.raises(UsageError, match="one at least"):
        PointMean.of([])
    narrow = ExactGP(SquaredExponential((0,)), np.zeros(2), -1.0).condition(
        rng.normal(size=(4, 1)), np.ones(4)
    )
    with pytest.raises(UsageError, match=r"widths: \[1, 5\]"):
        PointMean.of([good, narrow])
    some = ExactGP(SquaredExponential((0, 1)), np.zeros(3), -1.0).condition(good.X, good.y)
    linear = ExactGP(Linear(tuple(range(D))), np.zeros(D), -1.0).condition(good.X, good.y)
    for other in (some, linear):
        with pytest.raises(UsageError, match="squared exponential kernel of all 5 inputs"):
            PointMean.of([good, other])
    with pytest.raises(UsageError, match="one input of shape"):
        PointMean.of([good])(np.zeros((1, D)))
