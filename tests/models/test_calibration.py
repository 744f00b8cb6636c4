"""Calibration: scores with known answers, held-out trajectories, blocks."""

from __future__ import annotations

import numpy as np
import pytest

from etude.errors import UsageError
from etude.models.gp.exact import ExactGP, ExactPosterior
from etude.models.gp.kernels import SquaredExponential
from etude.models.held_out import contiguous_blocks, inflation, score


def held_out_z2(posterior: ExactPosterior, group: np.ndarray) -> float:
    """Mean z^2 when each group is predicted from the others, in closed form."""
    mean, variance = posterior.leave_group_out(group)
    return float(np.mean((posterior.y - mean) ** 2 / variance))


def test_errors_of_the_predicted_size_score_one() -> None:
    rng = np.random.default_rng(0)
    mean = rng.normal(size=(20000, 2)) * 5.0
    tau = mean + rng.normal(size=mean.shape) * np.array([0.5, 2.0])
    result = score(tau, mean, np.broadcast_to([0.25, 4.0], mean.shape), np.ones(mean.shape, dtype=bool))
    np.testing.assert_allclose(result.z2, 1.0, atol=0.04)
    np.testing.assert_allclose(result.coverage, 0.95, atol=0.01)
    np.testing.assert_allclose(result.nmse, [0.25 / 25.25, 4.0 / 29.0], rtol=0.05)


def test_predicting_the_mean_has_nmse_one_and_no_variance_means_no_z2() -> None:
    tau = np.random.default_rng(1).normal(size=(50, 1))
    result = score(tau, np.full_like(tau, tau.mean()), None, np.ones(tau.shape, dtype=bool))
    assert result.nmse[0] == pytest.approx(1.0)
    assert np.isnan(result.z2[0])
    assert np.isnan(result.coverage[0])


def test_stuck_samples_do_not_count() -> None:
    rng = np.random.default_rng(2)
    tau, mean, variance = rng.normal(size=(30, 2)), rng.normal(size=(30, 2)), np.ones((30, 2))
    moving = rng.uniform(size=tau.shape) > 0.3
    moving[:, 1] = False
    spoiled = np.where(moving, tau, 1e6)
    first, second = score(tau, mean, variance, moving), score(spoiled, mean, variance, moving)
    assert first.z2[0] == second.z2[0]
    assert np.isnan(first.nmse[1])


def test_held_out_z2_is_that_of_processes_without_the_group() -> None:
    rng = np.random.default_rng(3)
    X, y = rng.normal(size=(40, 2)), rng.normal(size=40)
    group = np.repeat([0, 1, 2, 3], 10)
    gp = ExactGP(SquaredExponential((0, 1)), np.zeros(3), np.log(0.4))
    squares = []
    for number in range(4):
        own = group == number
        mean, variance = gp.condition(X[~own], y[~own]).predict(X[own])
        squares.append((y[own] - mean) ** 2 / (variance + gp.noise_variance))
    assert held_out_z2(gp.condition(X, y), group) == pytest.approx(np.mean(squares), rel=1e-9)


def test_too_small_a_noise_is_found_and_inflated() -> None:
    rng = np.random.default_rng(4)
    X = rng.uniform(-3, 3, size=(150, 1))
    y = np.sin(X[:, 0]) + 0.3 * rng.normal(size=150)
    group = np.repeat(np.arange(5), 30)
    kernel, theta = SquaredExponential((0,)), np.log([1.0, 1.0])
    honest = held_out_z2(ExactGP(kernel, theta, np.log(0.3)).condition(X, y), group)
    bold = held_out_z2(ExactGP(kernel, theta, np.log(0.06)).condition(X, y), group)
    assert 0.75 < honest < 1.3
    assert bold > 8.0
    assert inflation(bold) == bold


def test_inflation_never_shrinks_and_ignores_the_unknown() -> None:
    assert inflation(0.3) == 1.0
    assert inflation(np.nan) == 1.0


def test_blocks_are_contiguous_within_trajectories() -> None:
    t = np.concatenate([np.arange(0, 20, 0.5), np.arange(0, 9, 0.5)])
    group = np.repeat([4, 7], [40, 18])
    blocks = contiguous_blocks(t, group, 5.0)
    assert len(np.unique(blocks)) == 6
    assert set(blocks[:40]).isdisjoint(blocks[40:])
    for part in (blocks[:40], blocks[40:]):
        assert np.all(np.diff(part) >= 0)
    with pytest.raises(UsageError, match="positive length"):
        contiguous_blocks(t, group, 0.0)


def test_shapes_must_agree() -> None:
    with pytest.raises(UsageError, match="one shape"):
        score(np.zeros((3, 2)), np.zeros((3, 1)), None, np.ones((3, 2), dtype=bool))
