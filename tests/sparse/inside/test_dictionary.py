"""The dictionary's choice: golden numbers, an oracle by plain inverses, and what each rule promises."""

from __future__ import annotations

import numpy as np
import pytest
from arm_kernel import structured_kernel
from dictionary_examples import chosen_by_inverses, motion, outputs, process
from hypothesis import given, settings
from hypothesis import strategies as st

from etude.errors import DataError, UsageError
from etude.models import ExactGP, SquaredExponential
from etude_sparse import DictionaryConfig, DictionaryGP, dictionary_stream

D = 4


def five_points(noise_variance: float) -> dictionary_stream.DictionaryStream:
    X = np.linspace(0.0, 1.0, 5)[:, None]
    theta = np.log([np.sqrt(1.5), 0.5])
    gp = ExactGP(SquaredExponential((0,)), theta, 0.5 * np.log(noise_variance))
    stream = DictionaryGP(gp, DictionaryConfig(size=5)).stream(1)
    stream.offer(X, np.sin(3.0 * X[:, 0]))
    return stream


def test_golden_variances_without_noise(monkeypatch) -> None:
    """Numbers computed with 50 digits: delta of the member at 0.5 and of a candidate at 0.6."""
    monkeypatch.setattr(dictionary_stream, "LEAST_DIAGONAL", 1e-25)
    stream = five_points(1e-25)
    assert stream.member_scores()[0][2] == pytest.approx(0.00361606525674058, rel=1e-9)
    assert stream.predict(np.array([[0.6]]))[1][0] == pytest.approx(1.89220311308582e-5, rel=1e-9)


def test_golden_leave_one_out_with_noise() -> None:
    variance, error = five_points(0.01).member_scores()
    assert variance[2] == pytest.approx(0.0252646537454372, rel=1e-11)
    assert error[2] == pytest.approx(np.sin(1.5) - 1.01307229720257, rel=1e-10)


RULES = {
    "variance": DictionaryConfig(size=15, refresh_every=7),
    "variance, any gain": DictionaryConfig(size=15, gain=0.0),
    "variance, threshold": DictionaryConfig(size=15, threshold=0.05),
    "error": DictionaryConfig(size=15, rule="error", guard=None),
    "error, threshold": DictionaryConfig(size=15, rule="error", guard=None, threshold=0.1),
    "error, guarded": DictionaryConfig(size=15, rule="error"),
    "error, tight guard": DictionaryConfig(size=15, rule="error", guard=0.5),
    "variance, ageing": DictionaryConfig(size=15, half_life=20.0),
    "error, guarded, ageing": DictionaryConfig(size=15, rule="error", half_life=20.0),
}


@pytest.mark.thinned
@pytest.mark.parametrize("config", RULES.values(), ids=RULES.keys())
@pytest.mark.parametrize("structured", [False, True], ids=["ARD-SE", "structured"])
def test_the_choice_is_that_of_plain_inverses(config: DictionaryConfig, structured: bool) -> None:
    rng = np.random.default_rng(1)
    X = motion(rng, 60, D, rate=1.0)
    y = outputs(X, rng)
    gp = process(D, 1e-3)
    if structured:
        kernel = structured_kernel(1, 0)
        gp = ExactGP(kernel, kernel.initial(np.ones(D), 1.0), np.log(0.05))
    signal = float(gp.kernel.diagonal(gp.theta, X).mean())
    oracle = DictionaryConfig(**{**vars(config), "threshold": config.threshold * np.sqrt(signal)})
    expected = chosen_by_inverses(gp, oracle, X, y, gp.noise_variance)
    result = DictionaryGP(gp, config).select(X, y)
    assert result.kept.tolist() == expected
    assert len(expected) == 15
    assert max(expected) >= 20


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([1e-8, 1e-4, 1e-2]), st.sampled_from([0.0, 0.1]))
def test_the_variance_rule_never_lowers_the_determinant(seed: int, noise: float, gain: float) -> None:
    rng = np.random.default_rng(seed)
    X = motion(rng, 300, D, rate=10.0)
    stream = DictionaryGP(process(D, noise), DictionaryConfig(size=20, gain=gain)).stream(D)
    stream.offer(X[:20], np.zeros(20))
    carried, computed = [stream.log_det], [_log_det(stream)]
    for x in X[20:]:
        if stream.offer(x[None], np.zeros(1)):
            carried.append(stream.log_det)
            computed.append(_log_det(stream))
    assert len(carried) > 5
    assert np.diff(carried).min() > -1e-8
    assert np.diff(computed).min() > -1e-7
    np.testing.assert_allclose(carried, computed, rtol=1e-6, atol=1e-6)


def _log_det(stream: dictionary_stream.DictionaryStream) -> float:
    K = stream.gp.kernel.value(stream.gp.theta, stream.X, stream.X)
    return float(np.linalg.slogdet(K + stream.diagonal * np.eye(len(K)))[1])


def contaminated() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(4)
    X = np.concatenate([motion(rng, 600, D, rate=10.0) for _ in range(5)])
    y = outputs(X, rng)
    bad = rng.uniform(size=len(X)) < 0.05
    return X, y + np.where(bad, 3.0 * rng.normal(size=len(X)), 0.0), bad, motion(rng, 600, D, rate=10.0)


def test_the_guarded_error_rule_does_not_hoard_outliers() -> None:
    X, y, bad, test = contaminated()
    share, error = {}, {}
    for name, config in {
        "variance": DictionaryConfig(size=150),
        "bare": DictionaryConfig(size=150, rule="error", guard=None),
        "guarded": DictionaryConfig(size=150, rule="error"),
    }.items():
        result = DictionaryGP(process(D, 0.05**2), config).select(X, y)
        share[name] = bad[result.kept].mean()
        truth = outputs(test, np.random.default_rng(0), noise=0.0)
        error[name] = float(np.mean((result.posterior.predict(test)[0] - truth) ** 2))
    assert share["bare"] > 0.3
    assert share["guarded"] < 0.1
    assert error["guarded"] < 0.3 * error["bare"]
    assert error["guarded"] < 1.5 * error["variance"]


@pytest.mark.parametrize("rule", ["variance", "error"])
def test_age_lets_a_changed_robot_be_followed(rule: str) -> None:
    rng = np.random.default_rng(5)
    X = motion(rng, 1200, D, rate=10.0)
    old, new = outputs(X, rng), 1.5 * outputs(X, rng) + 0.5
    error = {}
    for half_life in (None, 30.0):
        gp = DictionaryGP(process(D, 0.05**2), DictionaryConfig(size=100, rule=rule, half_life=half_life))
        stream = gp.stream(D)
        stream.offer(X, old, np.arange(1200) / 10.0)
        stream.offer(X, new, 120.0 + np.arange(1200) / 10.0)
        error[half_life] = float(np.mean((stream.predict(X)[0] - new) ** 2))
    assert error[30.0] < 0.3 * error[None]
    assert error[30.0] < 0.1 * np.var(new)


def test_members_can_be_chosen_to_start_with() -> None:
    rng = np.random.default_rng(6)
    X = motion(rng, 200, D, rate=10.0)
    y = outputs(X, rng)
    start = np.arange(0, 200, 10)
    filled = DictionaryGP(process(D, 1e-2), DictionaryConfig(size=20, threshold=0.0, gain=1e9))
    assert filled.select(X, y, start=start).kept.tolist() == start.tolist()
    result = DictionaryGP(process(D, 1e-2), DictionaryConfig(size=20)).select(X, y, start=start)
    assert len(set(result.kept.tolist())) == 20
    np.testing.assert_array_equal(result.posterior.X, X[result.kept])
    for wrong in ([3, 2], [0, 200], [-1, 4], [0.5]):
        with pytest.raises(UsageError, match="start must"):
            filled.select(X, y, start=np.array(wrong))


def test_a_dictionary_large_enough_is_the_exact_process() -> None:
    rng = np.random.default_rng(7)
    X = motion(rng, 50, D, rate=1.0)
    y, gp = outputs(X, rng), process(D, 1e-3)
    whole, exact = DictionaryGP(gp, DictionaryConfig(size=64)), gp.condition(X, y)
    test = motion(rng, 20, D, rate=1.0)
    for ours, theirs in zip(whole.condition(X, y).predict(test), exact.predict(test), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-14)
    assert whole.log_marginal_likelihood(X, y)[0] == gp.log_marginal_likelihood(X, y)[0]


@pytest.mark.parametrize(
    "options",
    [
        {"rule": "both"},
        {"size": 0},
        {"refresh_every": 0},
        {"guard": 0.0},
        {"half_life": -1.0},
        {"threshold": np.nan},
        {"gain": -0.1},
    ],
)
def test_a_config_names_what_is_wrong(options: dict) -> None:
    with pytest.raises(UsageError, match=next(iter(options))):
        DictionaryConfig(**options)


def test_a_threshold_that_nothing_passes() -> None:
    with pytest.raises(DataError, match="empty"):
        DictionaryGP(process(D, 1e-2), DictionaryConfig(threshold=2.0)).condition(np.ones((3, D)), np.ones(3))
