"""Scores with known answers, over moving and over all usable samples, and of each trajectory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from learning_examples import commanded, trajectories, trajectory
from scipy.stats import norm
from scipy.stats import t as student

from etude.errors import DataError, UsageError
from etude.models import (
    ExactGP,
    SquaredExponential,
    figures,
    prediction_score,
    score_trajectories,
)
from etude.models.accuracy import inflation, trivial_prediction
from etude.models.student_t import StudentT


def held_out_z2(gp: ExactGP, X: np.ndarray, y: np.ndarray, group: np.ndarray) -> float:
    """Mean z^2 when each group is predicted from the others."""
    z2 = np.empty_like(y)
    for number in np.unique(group):
        own = group == number
        mean, variance = gp.condition(X[~own], y[~own]).predict(X[own])
        z2[own] = (y[own] - mean) ** 2 / (variance + gp.noise_variance)
    return float(z2.mean())


def test_errors_of_the_predicted_size_score_one() -> None:
    rng = np.random.default_rng(0)
    mean = rng.normal(size=(20000, 2)) * 5.0
    tau = mean + rng.normal(size=mean.shape) * np.array([0.5, 2.0])
    result = figures(tau, mean, np.broadcast_to([0.25, 4.0], mean.shape), np.ones(mean.shape, dtype=bool))
    np.testing.assert_allclose(result.z2, 1.0, atol=0.04)
    np.testing.assert_allclose(result.coverage, 0.95, atol=0.01)
    np.testing.assert_allclose(result.nmse, [0.25 / 25.25, 4.0 / 29.0], rtol=0.05)


def test_predicting_the_mean_has_nmse_one_and_no_variance_means_no_z2() -> None:
    tau = np.random.default_rng(1).normal(size=(50, 1))
    result = figures(tau, np.full_like(tau, tau.mean()), None, np.ones(tau.shape, dtype=bool))
    assert result.nmse[0] == pytest.approx(1.0)
    assert np.isnan(result.z2[0])
    assert np.isnan(result.coverage[0])


def test_stuck_samples_do_not_count() -> None:
    rng = np.random.default_rng(2)
    tau, mean, variance = rng.normal(size=(30, 2)), rng.normal(size=(30, 2)), np.ones((30, 2))
    moving = rng.uniform(size=tau.shape) > 0.3
    moving[:, 1] = False
    spoiled = np.where(moving, tau, 1e6)
    first, second = figures(tau, mean, variance, moving), figures(spoiled, mean, variance, moving)
    assert first.z2[0] == second.z2[0]
    assert np.isnan(first.nmse[1])


def test_too_small_a_noise_is_found_and_inflated() -> None:
    rng = np.random.default_rng(4)
    X = rng.uniform(-3, 3, size=(150, 1))
    y = np.sin(X[:, 0]) + 0.3 * rng.normal(size=150)
    group = np.repeat(np.arange(5), 30)
    kernel, theta = SquaredExponential((0,)), np.log([1.0, 1.0])
    honest = held_out_z2(ExactGP(kernel, theta, np.log(0.3)), X, y, group)
    bold = held_out_z2(ExactGP(kernel, theta, np.log(0.06)), X, y, group)
    assert 0.75 < honest < 1.3
    assert bold > 8.0
    assert inflation(bold) == bold


def test_inflation_never_shrinks_and_ignores_the_unknown() -> None:
    assert inflation(0.3) == 1.0
    assert inflation(np.nan) == 1.0


def test_shapes_must_agree() -> None:
    with pytest.raises(UsageError, match="one shape"):
        figures(np.zeros((3, 2)), np.zeros((3, 1)), None, np.ones((3, 2), dtype=bool))


def test_a_score_is_over_moving_samples_and_beside_them_over_all_while_any_joint_moves() -> None:
    data = trajectories(2)
    data = replace(data, moving=data.moving & (data.t[:, None] < 20.0))
    data = replace(data, usable=data.t[:, None] + np.zeros(2) > 3.0)
    mean, variance = data.command + 0.3, np.full_like(data.command, 0.09)
    found = prediction_score(data, mean, variance, data)
    for own, use in (
        (found, data.usable & data.moving),
        (found.usable, data.usable & data.moving.any(axis=1)[:, None]),
    ):
        expected = [0.09 / data.command[k, j].var() for j, k in enumerate(use.T)]
        np.testing.assert_allclose(own.nmse, expected)
        np.testing.assert_allclose(own.z2, 1.0)
        np.testing.assert_array_equal(own.coverage, 1.0)
    assert not np.allclose(found.nmse, found.usable.nmse)
    standing = ~data.moving.any(axis=1)
    assert standing.any()
    spoiled = prediction_score(data, np.where(standing[:, None], 1e6, mean), variance, data)
    np.testing.assert_array_equal(spoiled.usable.nmse, found.usable.nmse)


def test_the_log_loss_is_beside_a_normal_distribution_of_the_training_commands() -> None:
    data, new = trajectories(2), trajectory(7)
    mean, variance = new.command + 0.3, np.full_like(new.command, 0.2)
    found = prediction_score(new, mean, variance, data)
    for j, use in enumerate(new.moving.T):
        y = new.command[use, j]
        own = -norm.logpdf(y, mean[use, j], np.sqrt(0.2)).mean()
        trivial = -norm.logpdf(y, data.command[:, j].mean(), data.command[:, j].std()).mean()
        assert found.msll[j] == pytest.approx(own - trivial)
    constant = prediction_score(
        new, *np.broadcast_arrays(*trivial_prediction(data)[:, None], new.command)[:2], data
    )
    np.testing.assert_allclose(constant.msll, 0.0, atol=1e-12)
    assert np.isnan(prediction_score(new, mean, variance).msll).all()


def test_scores_of_each_trajectory_are_those_of_their_definition() -> None:
    data = trajectories(2)
    rng = np.random.default_rng(0)
    error = 0.4 * rng.standard_normal(data.command.shape)
    variance = rng.uniform(0.1, 0.3, error.shape)
    tails = StudentT(4.0, 0.8)
    found = score_trajectories(data, data.command - error, variance, tails)
    own = data.group == 1
    e, deviation, late = error[own], np.sqrt(variance[own]), data.t[own] >= 5.0
    assert found.mae[1] == pytest.approx(np.abs(e).mean())
    assert found.mae_after[1] == pytest.approx(np.abs(e[late]).mean())
    assert found.z2[1] == pytest.approx((e**2 / deviation**2).mean())
    assert found.coverage[1] == pytest.approx((np.abs(e) < 1.96 * deviation).mean(), abs=2e-3)
    assert found.nlpd[1] == pytest.approx(-norm.logpdf(e, scale=deviation).mean())
    assert found.nlpd_t[1] == pytest.approx(-student.logpdf(e, 4.0, scale=0.8 * deviation).mean())
    assert np.isnan(score_trajectories(data, data.command, variance).nlpd_t).all()
    with pytest.raises(DataError, match="no sample"):
        score_trajectories(data.take(np.zeros(len(data), dtype=bool)), error[:0], variance[:0])


def test_commands_that_say_nothing_are_not_looked_at() -> None:
    data = trajectory(0)
    usable = np.ones_like(data.usable)
    usable[::3, 0] = False
    spoiled = commanded(data, np.where(usable, data.command, np.nan))
    found = prediction_score(replace(spoiled, usable=usable), 0.0 * data.command, np.ones_like(data.command))
    assert np.isfinite(found.nmse).all()
