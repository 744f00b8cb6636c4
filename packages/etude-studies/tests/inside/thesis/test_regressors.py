"""Regressors beside the thesis's: gradients, trees and random features against what is known of them."""

from __future__ import annotations

import numpy as np
import pytest

from etude_studies.measured import Measured
from etude_studies.thesis import regressor_runs
from etude_studies.thesis.arm import baseline
from etude_studies.thesis.arm_motions import draws
from etude_studies.thesis.flight_settings import FlightSettings
from etude_studies.thesis.flight_tests import flown_tests
from etude_studies.thesis.regressors import (
    NetworkSetting,
    TreeSetting,
    best_of,
    boosted,
    features,
    first_weights,
    grown,
    independent,
    loss_gradient,
    network,
    orthogonal,
    standardised,
)

RNG = np.random.default_rng


def test_the_gradient_of_a_network_is_that_of_its_loss() -> None:
    rng = RNG(0)
    X, Y = rng.normal(size=(9, 3)), rng.normal(size=(9, 2))
    weights = [(W.astype(float), b + rng.normal(size=b.shape)) for W, b in first_weights((3, 5, 4, 2), rng)]
    _, gradient = loss_gradient(weights, X, Y, 0.1)
    step = 1e-6
    for values, slopes in zip(weights, gradient, strict=True):
        for w, g in zip(values, slopes, strict=True):
            for place in np.ndindex(w.shape):
                ends = []
                for sign in (step, -step):
                    w[place] += sign
                    ends.append(loss_gradient(weights, X, Y, 0.1)[0])
                    w[place] -= sign
                # differences of 1e-6 have 1e-9 of rounding
                assert g[place] == pytest.approx((ends[0] - ends[1]) / (2 * step), abs=1e-8)


def test_a_network_learns_a_plane() -> None:
    X = RNG(1).normal(size=(600, 2))
    plane = X @ np.array([[1.0, 0.5], [-2.0, 1.0]]) + 3.0
    predict = standardised(network)(NetworkSetting(32, 0.01, 0.0), X[:500], plane[:500], RNG(2))
    # tanh layers bend a plane a little at the edge of the data
    assert np.abs(predict(X[500:]) - plane[500:]).mean() < 0.03 * plane.std()


def test_a_tree_finds_the_cuts_of_a_step_function() -> None:
    bins = np.stack(np.meshgrid(np.arange(8), np.arange(8)), axis=-1).reshape(-1, 2)
    y = np.where(bins[:, 0] > 4, 3.0, 0.0) + np.where(bins[:, 1] > 1, 1.0, 0.0)
    tree = grown(TreeSetting(2, 1.0, 1), bins, y)
    assert (tree.column[0], tree.cut[0]) == (0, 4)
    assert tree.predict(bins) == pytest.approx(y)
    few = grown(TreeSetting(1, 1.0, 30), bins, y)  # the best cut would leave 24 of 64 on one side
    assert few.cut[0] == 3


def test_boosting_adds_up_what_one_tree_cannot_say() -> None:
    X = RNG(3).uniform(-1.0, 1.0, (800, 2))
    y = np.sign(X[:, :1]) + 2.0 * (X[:, 1:] > 0.3)
    predict = boosted(TreeSetting(1, 0.2, 5), X, y, RNG(0))
    inside = (np.abs(X[:, 0]) > 0.1) & (np.abs(X[:, 1] - 0.3) > 0.1)
    # the bins (0.06 wide) that hold a step are of both sides, which the shallow trees around them smear
    assert np.abs(predict(X) - y)[inside].max() < 0.1


def test_orthogonal_frequencies_are_orthogonal_and_as_long_as_independent_ones() -> None:
    W = orthogonal(12, 4, RNG(4))
    for block in W.reshape(3, 4, 4):
        gram = block @ block.T
        assert gram == pytest.approx(np.diag(np.diag(gram)), abs=1e-12)
    sizes = [np.mean(np.sum(draw(4000, 4, RNG(5)) ** 2, axis=1)) for draw in (orthogonal, independent)]
    assert sizes == pytest.approx([4.0, 4.0], rel=0.05)  # of a chi-squared with 4 degrees, 4,000 draws


def test_orthogonal_features_are_nearer_to_the_kernel_and_give_its_mean() -> None:
    """Yu et al. 2016: less variance than independent ones; with many both give the exact process's mean."""
    rng, lengths, ridge = RNG(6), np.array([0.7, 1.5, 1.0]), 0.05
    X, new = rng.normal(size=(40, 3)), rng.normal(size=(30, 3))
    y = np.sin(X[:, 0]) + X[:, 1]

    def kernel(A: np.ndarray, B: np.ndarray) -> np.ndarray:
        return np.exp(-0.5 * np.sum(((A[:, None] - B[None]) / lengths) ** 2, axis=2))

    exact = kernel(new, X) @ np.linalg.solve(kernel(X, X) + ridge * np.eye(40), y)

    def wrong(draw, points: int) -> float:
        found = [features(draw(points, 3, RNG(s)), lengths, X, y, ridge)(new) for s in range(6)]
        return float(np.sqrt(np.mean((np.array(found) - exact) ** 2)))

    assert wrong(orthogonal, 600) < 0.1 * y.std()
    assert wrong(orthogonal, 30) < wrong(independent, 30)


def test_tuning_takes_the_setting_that_predicts_groups_left_out() -> None:
    rng = RNG(7)
    X, group = rng.normal(size=(200, 1)), np.repeat(np.arange(4), 50)
    Y = 2.0 * X + 0.5 * rng.normal(size=(200, 1))
    seen = []

    def fit(degree, X, Y, rng):
        seen.append(degree)
        weights = np.linalg.lstsq(np.vander(X[:, 0], degree + 1), Y, rcond=None)[0]
        return lambda new: np.vander(new[:, 0], degree + 1) @ weights

    best_of(standardised(fit), [0, 1, 15], X, Y, group, rng)
    assert seen[-1] == 1


@pytest.mark.slow
def test_every_method_leaves_less_error_on_the_arm_than_feedback_alone() -> None:
    seed, drawn = 100, draws({"motions": "scaled"}, 100, {})
    every = {"rounds": 2, "methods": list(regressor_runs.ON_ARMS)}
    arm = regressor_runs.on_the_arm(every, seed, {"draws": drawn})
    alone = baseline({"robot": "arm4", "rounds": 1, "controller": "pd"}, seed, {})
    for test in ("fourier", "moves", "common"):
        found = _by_model(arm, "error", test)
        assert set(found) == set(regressor_runs.ON_ARMS)
        assert max(found.values()) < 0.8 * _by_model(alone, "error", test)[""], (test, found)


@pytest.mark.slow
def test_every_method_predicts_the_voltages_of_a_flight() -> None:
    """After two flights less error than a deviation of the voltages; trees, which know physics, than half."""
    settings = {"flights": 2, "tests": (3, 2, 0)}
    flights = regressor_runs.on_flights(settings, 1000, {})
    spread = float(flown_tests(FlightSettings(**settings), 1000).deviation.mean())
    for test in ("uniform", "boundary"):
        found = _by_model(flights, "mae", test)
        assert set(found) == set(regressor_runs.ANYWHERE)
        assert max(found.values()) < spread, (test, found, spread)
        assert found["trees"] < 0.5 * spread


def _by_model(rows: list[Measured], measure: str, test: str) -> dict[str, float]:
    own = (row for row in rows if (row.measure, row.test, row.part) == (measure, test, "mean"))
    return {row.model: row.value for row in own}
