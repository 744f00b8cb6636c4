"""The dictionary's arithmetic while points stream past: identities, rounding, refreshes, bad input."""

from __future__ import annotations

import numpy as np
import pytest
from arm_kernel import structured_kernel
from dictionary_examples import motion, outputs, process

from etude.errors import DataError, NumericalError, UsageError
from etude.models import ExactGP, Linear
from etude_sparse import DictionaryConfig, DictionaryGP, DictionaryStream

D = 4
RULES = {
    "variance": DictionaryConfig(size=40),
    "error": DictionaryConfig(size=40, rule="error", guard=None),
    "guarded": DictionaryConfig(size=40, rule="error"),
    "ageing": DictionaryConfig(size=40, half_life=50.0),
}


def streamed(
    config: DictionaryConfig, noise: float, samples: int = 1500
) -> tuple[DictionaryStream, np.ndarray]:
    rng = np.random.default_rng(0)
    X = motion(rng, samples, D)
    stream = DictionaryGP(process(D, noise), config).stream(D)
    stream.offer(X, outputs(X, rng))
    return stream, X


def check_identities(stream: DictionaryStream, tolerance: float) -> None:
    n, gp = len(stream), stream.gp
    A = gp.kernel.value(gp.theta, stream.X, stream.X) + stream.diagonal * np.eye(n)
    P = np.linalg.inv(A)
    variance, error = stream.member_scores()
    np.testing.assert_allclose(variance, 1.0 / P.diagonal(), rtol=tolerance)
    np.testing.assert_allclose(error, P @ stream.y / P.diagonal(), rtol=tolerance, atol=tolerance)
    assert stream.log_det == pytest.approx(np.linalg.slogdet(A)[1], rel=tolerance)
    assert stream.drift() < tolerance


@pytest.mark.parametrize("config", RULES.values(), ids=RULES.keys())
def test_updates_equal_inverses_of_the_members(config: DictionaryConfig) -> None:
    stream, X = streamed(config, 1e-2)
    assert stream.replacements > 100
    np.testing.assert_array_equal(stream.X, X[stream.kept])
    check_identities(stream, 1e-8)


@pytest.mark.parametrize("config", RULES.values(), ids=RULES.keys())
def test_one_at_a_time_is_all_at_once(config: DictionaryConfig) -> None:
    rng = np.random.default_rng(2)
    X = motion(rng, 400, D, rate=10.0)
    y, gp = outputs(X, rng), DictionaryGP(process(D, 1e-2), config)
    whole, single = gp.stream(D), gp.stream(D)
    swaps = whole.offer(X, y)
    assert swaps == sum(single.offer(X[i : i + 1], y[i : i + 1]) for i in range(len(y)))
    assert single.kept.tolist() == whole.kept.tolist()


def test_rounding_after_ten_thousand_replacements() -> None:
    """The promise: 1e-6 at a noise of 1e-4 of the signal variance, on neighbouring samples of a motion."""
    rng = np.random.default_rng(3)
    gp = DictionaryGP(process(D, 1e-4), DictionaryConfig(size=100, half_life=50.0))
    stream, worst = gp.stream(D), 0.0
    while stream.replacements < 10_000:
        X = motion(rng, 480, D)
        stream.offer(X, outputs(X, rng))
        worst = max(worst, stream.drift())
    assert worst < 1e-7
    assert stream.refreshes == stream.replacements // 500


def test_refreshes_keep_rounding_away() -> None:
    """Without them the same stream ends an order of magnitude worse; so they do run, and they help."""
    drifts = []
    for refresh_every in (50, 10**9):
        config = DictionaryConfig(size=60, half_life=30.0, refresh_every=refresh_every)
        drifts.append(streamed(config, 1e-6, samples=3000)[0].drift())
    assert drifts[0] < 0.3 * drifts[1]


@pytest.mark.parametrize("noise", [0.0, 1e-12, 1e-8, 1e-6, 1e-2])
@pytest.mark.parametrize("config", RULES.values(), ids=RULES.keys())
def test_no_setting_ends_in_nan(config: DictionaryConfig, noise: float) -> None:
    """Duplicates, a stretch at rest, a jump, at any noise; d is then 1e-6 of the signal variance or more."""
    rng = np.random.default_rng(4)
    X = np.concatenate([motion(rng, 500, D), np.ones((100, D)), motion(rng, 300, D), np.ones((100, D))])
    stream = DictionaryGP(process(D, noise), config).stream(D)
    stream.offer(X, outputs(X, rng))
    assert stream.diagonal >= 1e-6
    variance, error = stream.member_scores()
    assert np.isfinite(variance).all()
    assert np.isfinite(error).all()
    assert np.all(variance >= 0.99 * stream.diagonal)
    assert stream.drift() < 1e-4
    mean, latent = stream.predict(X[:50])
    assert np.isfinite(mean).all()
    assert np.all(latent >= 0.0)


def test_the_stream_predicts_as_its_posterior() -> None:
    stream, X = streamed(DictionaryConfig(size=40), 1e-2)
    test = X[::50] + 0.1
    posterior = stream.posterior()
    for ours, theirs in zip(stream.predict(test), posterior.predict(test), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-8, atol=1e-9)
    assert posterior.noise_variance == stream.diagonal


@pytest.mark.parametrize("kernel", [structured_kernel(2, 0), Linear((0, 3)) * Linear((1,))])
def test_one_point_at_a_time_equals_many_compiled_or_not(kernel) -> None:
    """The second kernel has two linear factors, for which a single row is not compiled."""
    rng = np.random.default_rng(12)
    X, gp = motion(rng, 60, 8, rate=5.0), ExactGP(kernel, 0.2 * rng.normal(size=kernel.size), -2.0)
    y, streams = outputs(X, rng), []
    for step in (1, 60):
        streams.append(DictionaryGP(gp, DictionaryConfig(size=15)).stream(8))
        for first in range(0, 60, step):
            streams[-1].offer(X[first : first + step], y[first : first + step])
    assert np.array_equal(streams[0].kept, streams[1].kept)
    wanted = streams[1].predict(X)[0]
    assert np.allclose([streams[0].mean(x) for x in X], wanted, atol=1e-7 * np.abs(wanted).max())


def test_a_spoilt_inverse_is_noticed_and_repaired() -> None:
    stream, X = streamed(DictionaryConfig(size=40), 1e-2)
    stream._members.P[:] *= 3.0
    before = stream.refreshes
    stream.offer(X[:50], np.zeros(50))
    assert stream.refreshes > before
    check_identities(stream, 1e-8)


def test_a_covariance_that_outgrows_its_first_points() -> None:
    """d comes from the first points offered; a linear kernel is 1e12 times larger later on."""
    gp = ExactGP(Linear((0, 1)), np.zeros(2), -60.0)
    stream = DictionaryGP(gp, DictionaryConfig(size=5)).stream(2)
    stream.offer(np.full((2, 2), 1e-3), np.zeros(2))
    rng = np.random.default_rng(5)
    X = 1e3 * rng.normal(size=(300, 2))
    stream.offer(X, X[:, 0])
    assert np.isfinite(stream.member_scores()).all()
    assert np.all(stream.member_scores()[0] > 0.0)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_the_scale_of_the_inputs_changes_nothing(scale: float) -> None:
    rng = np.random.default_rng(6)
    X = motion(rng, 300, D, rate=10.0)
    y = outputs(X, rng)
    config = DictionaryConfig(size=30)
    small = DictionaryGP(process(D, 1e-2), config).select(X, y)
    large = DictionaryGP(process(D, 1e-2, length=2.0 * scale), config).select(scale * X, y)
    assert small.kept.tolist() == large.kept.tolist()


@pytest.mark.parametrize("structured", [False, True])
def test_few_points(structured: bool) -> None:
    """One point, fewer points than inputs, constant outputs: the exact process on what there is."""
    kernel = structured_kernel(1, 0)
    gp = ExactGP(kernel, kernel.initial(np.ones(D), 1.0), np.log(0.05)) if structured else process(D, 1e-2)
    X = np.random.default_rng(7).normal(size=(3, D))
    for n in (1, 3):
        posterior = DictionaryGP(gp).condition(X[:n], np.zeros(n))
        np.testing.assert_array_equal(posterior.predict(X)[0], np.zeros(3))
        exact = gp.condition(X[:n], np.zeros(n))
        np.testing.assert_allclose(posterior.predict(X)[1], exact.predict(X)[1], rtol=1e-9, atol=1e-12)


def test_bad_points_are_refused_and_change_nothing() -> None:
    stream, X = streamed(DictionaryConfig(size=40), 1e-2)
    kept = stream.kept.tolist()
    with pytest.raises(DataError, match="NaN"):
        stream.offer(np.where(X[:5] > 0, np.nan, 1.0), np.zeros(5))
    with pytest.raises(DataError, match="inputs"):
        stream.offer(X[:5], np.zeros(4))
    with pytest.raises(DataError, match="4 columns, got 3"):
        stream.offer(X[:5, :3], np.zeros(5))
    with pytest.raises(DataError, match="backwards"):
        stream.offer(X[:3], np.zeros(3), np.array([0.0, 2.0, 1.0]))
    with pytest.raises(DataError, match="one finite time"):
        stream.offer(X[:2], np.zeros(2), np.array([0.0, np.nan]))
    with pytest.raises(UsageError, match="expected inputs"):
        stream.predict(X[:, :2])
    assert stream.kept.tolist() == kept


def test_neither_prior_nor_noise() -> None:
    gp = ExactGP(Linear((0,)), np.zeros(1), -400.0)
    with pytest.raises(NumericalError, match="diagonal term"):
        DictionaryGP(gp).stream(1).offer(np.zeros((2, 1)), np.zeros(2))


def test_an_empty_dictionary_predicts_the_prior() -> None:
    stream = DictionaryGP(process(D, 1e-2)).stream(D)
    mean, variance = stream.predict(np.ones((2, D)))
    assert mean.tolist() == [0.0, 0.0]
    np.testing.assert_allclose(variance, 1.0)
