"""Criteria that count information: golden numbers, and the identities that define them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etude import plugins
from etude.design import Output, criterion_named, evaluate, needs_of, value_of
from etude.design.config import GROUP
from etude.design.criteria import RESOLUTION, Entropy, batch_of, info_gain, mi_region, sum_log
from etude.errors import UsageError
from etude.models import ExactGP, SquaredExponential

SEEDS = given(st.integers(0, 10**6))
MANY = settings(max_examples=25, deadline=None)


def test_golden_numbers() -> None:
    """X = 0, .25, .., 1; y = sin 3x; s0^2 = 1.5, length 0.5, sn^2 = 0.01: computed elsewhere to 50 digits."""
    X, T = np.linspace(0.0, 1.0, 5)[:, None], np.array([[0.6], [1.3]])
    gp = ExactGP(SquaredExponential((0,)), np.log([math.sqrt(1.5), 0.5]), math.log(0.1))
    output = Output.of(gp.condition(X, np.sin(3.0 * X[:, 0])), np.linspace(0.0, 1.0, 11)[:, None])
    for criterion, expected in (
        (info_gain, 1.74493241170752),
        (sum_log, 1.74796767582298),
        (mi_region, 0.280534849406926),
    ):
        assert value_of(criterion, [output], T, np.ones((2, 1))) == pytest.approx(expected, rel=1e-10)


def example(seed: int, n: int = 12, T: int = 6, r: int = 8) -> tuple[ExactGP, tuple[np.ndarray, ...]]:
    """A process, training inputs, planned samples, reference states, gains of the planned samples."""
    rng = np.random.default_rng(seed)
    gp = ExactGP(SquaredExponential((0, 1)), rng.uniform(-1.0, 0.5, 3), rng.uniform(-3.0, -0.5))
    return gp, (*(rng.uniform(-1.0, 1.0, (m, 2)) for m in (n, T, r)), rng.uniform(0.05, 1.0, T))


def given_data(gp: ExactGP, X: np.ndarray, R: np.ndarray | None = None) -> Output:
    return Output.of(gp.condition(X, np.zeros(len(X))), np.zeros((0, 2)) if R is None else R)


def value(criterion, output: Output, T: np.ndarray, gains: np.ndarray | None = None) -> float:
    gains = np.ones(len(T)) if gains is None else gains
    return value_of(criterion, [output], T, gains[:, None])


@SEEDS
@MANY
def test_chain_rule(seed: int) -> None:
    """Samples absorbed one after another, each by a refit, give in sum what they give together."""
    gp, (X, T, _, _) = example(seed)
    output, known, total = given_data(gp, X), X, 0.0
    joint = Entropy.of(batch_of(output.posterior, T).covariance(), np.ones(len(T)), output.noise)
    for t, sequential in enumerate(joint.factor.diagonal() ** 2 - output.noise):
        variance = gp.condition(known, np.zeros(len(known))).predict(T[t : t + 1])[1][0]
        assert sequential == pytest.approx(variance, rel=1e-6, abs=1e-8)
        total += 0.5 * math.log1p(variance / gp.noise_variance)
        known = np.concatenate([known, T[t : t + 1]])
    assert value(info_gain, output, T) == pytest.approx(total, rel=1e-8)


@SEEDS
@MANY
def test_chain_rule_over_trajectories(seed: int) -> None:
    """Planning two batches together or one after the other is the same: nothing depends on y."""
    gp, (X, T, _, _) = example(seed)
    first = value(info_gain, given_data(gp, X), T[:3])
    second = value(info_gain, given_data(gp, np.concatenate([X, T[:3]])), T[3:])
    assert value(info_gain, given_data(gp, X), T) == pytest.approx(first + second, rel=1e-8)


@SEEDS
@MANY
def test_joint_is_at_most_the_sum_is_at_most_the_trace(seed: int) -> None:
    gp, (X, T, _, gains) = example(seed)
    output = given_data(gp, X)
    variance = output.posterior.predict(T)[1]
    joint, single = value(info_gain, output, T, gains), value(sum_log, output, T, gains)
    assert 0.0 < joint <= single + 1e-10
    assert single <= gains**2 @ variance / (2.0 * gp.noise_variance) + 1e-10
    assert value(info_gain, output, T[:1]) == pytest.approx(value(sum_log, output, T[:1]), rel=1e-10)


@SEEDS
@MANY
def test_information_is_a_difference_of_log_determinants(seed: int) -> None:
    """1/2 (log det K_y(X and T) - log det K_y(X) - sum log noise), noise sn^2/gain^2, the plain way."""
    gp, (X, T, _, gains) = example(seed)
    both, noise = np.concatenate([X, T]), gp.noise_variance / gains**2
    K = gp.kernel.value(gp.theta, both, both)
    K += np.diag(np.concatenate([np.full(len(X), gp.noise_variance), noise]))
    difference = np.linalg.slogdet(K)[1] - np.linalg.slogdet(K[: len(X), : len(X)])[1]
    expected = 0.5 * (difference - np.log(noise).sum())
    assert value(info_gain, given_data(gp, X), T, gains) == pytest.approx(expected, rel=1e-8)


@SEEDS
@MANY
def test_mutual_information_is_symmetric_and_within_its_bounds(seed: int) -> None:
    gp, (X, T, R, gains) = example(seed)
    forth, back = value(mi_region, given_data(gp, X, R), T), value(mi_region, given_data(gp, X, T), R)
    assert forth == pytest.approx(back, rel=1e-8, abs=1e-10)
    for d in (np.ones(len(T)), gains):
        output = given_data(gp, X, R)
        mutual, all_of_it = value(mi_region, output, T, d), value(info_gain, output, T, d)
        assert 0.0 < mutual <= all_of_it + 1e-10


@SEEDS
@MANY
def test_mutual_information_is_what_the_samples_take_from_the_reference(seed: int) -> None:
    """I(y_T; y_R) = H(y_R) - H(y_R | y_T), with the samples absorbed by a refit."""
    gp, (X, T, R, _) = example(seed)
    before = value(info_gain, given_data(gp, X), R)
    after = value(info_gain, given_data(gp, np.concatenate([X, T])), R)
    assert value(mi_region, given_data(gp, X, R), T) == pytest.approx(before - after, rel=1e-7, abs=1e-9)


@SEEDS
@MANY
def test_information_is_monotone_and_submodular(seed: int) -> None:
    """A sample adds something, and less if more is known already."""
    gp, (X, T, _, _) = example(seed)
    output, last = given_data(gp, X), T[-1:]
    added = [
        value(info_gain, output, np.concatenate([T[:k], last]))
        - (value(info_gain, output, T[:k]) if k else 0.0)
        for k in range(len(T))
    ]
    assert min(added) > 0.0
    assert np.all(np.diff(added) <= 1e-9)


def test_repeating_a_sample_hardly_adds_to_the_joint_information() -> None:
    gp = ExactGP(SquaredExponential((0, 1)), np.zeros(3), math.log(0.1))
    output = given_data(gp, np.zeros((1, 2)))
    once = np.array([[0.9, -0.9]])
    twice, apart = np.repeat(once, 2, axis=0), np.array([[0.9, -0.9], [0.9, 0.9]])
    single = value(info_gain, output, once)
    assert value(sum_log, output, twice) == pytest.approx(2.0 * single)
    assert single < value(info_gain, output, twice) < 1.2 * single < value(info_gain, output, apart)


@pytest.mark.parametrize("criterion", [sum_log, info_gain, mi_region])
def test_without_noise_information_is_counted_against_a_resolution(criterion) -> None:
    """Repeated samples of a noise-free process: finite values and derivatives, no warning."""
    gp = ExactGP(SquaredExponential((0, 1)), np.zeros(3), -60.0)
    R = np.random.default_rng(0).uniform(-1.0, 1.0, (8, 2))
    output = given_data(gp, np.zeros((1, 2)), R)
    assert output.noise == RESOLUTION
    T = np.repeat(R[:3], 2, axis=0) + 1e-9
    score, in_X, in_gains = evaluate(criterion, [output], T, np.ones((6, 1)))
    assert 0.0 < score < 6 * 0.5 * math.log1p(1.0 / RESOLUTION)
    assert np.isfinite(in_X).all()
    assert np.isfinite(in_gains).all()


@pytest.mark.parametrize("name", plugins.BUILT_IN[GROUP])
def test_only_criteria_that_say_so_need_reference_states(name: str) -> None:
    gp, (X, T, R, gains) = example(3)
    without, with_, criterion = given_data(gp, X), given_data(gp, X, R), criterion_named(name)
    if needs_of(criterion) == "reference":
        assert value(criterion, with_, T) != value(criterion, given_data(gp, X, R[:4]), T)
    else:
        assert value(criterion, without, T, gains) == value(criterion, with_, T, gains)


def test_mutual_information_without_a_reference_is_refused() -> None:
    gp, (X, T, _, _) = example(0)
    with pytest.raises(UsageError, match="needs reference states"):
        value(mi_region, given_data(gp, X), T)
