"""Linear regression against the Gaussian process it is, and the identified model's regressor as features."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from etude.models.physics.base_parameters import spread_states
from etude.models.physics.base_regressor import BaseRegressor, base_regressors
from etude.models.physics.rigid_body import command_regressors
from etude.models.physics.rigid_tree import drives_from_mujoco, tree_from_mujoco
from rigid_examples import AWKWARD, NAMES, awkward_spec, smooth_motion

from etude.errors import DataError, NumericalError, UsageError
from etude.models.gp.bayesian_linear import BayesianLinear
from etude.models.gp.exact import ExactGP
from etude.models.gp.kernels import Linear


class Columns:
    """phi(x) = x."""

    def transform(self, X: np.ndarray) -> np.ndarray:
        return X

    def pullback(self, X: np.ndarray, G: np.ndarray) -> np.ndarray:
        return G


def data(n: int, scale: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(n)
    X, Z = scale * rng.standard_normal((n, 4)), scale * rng.standard_normal((6, 4))
    return X, X @ [1.0, -2.0, 0.0, 0.5] / scale + 0.1 * rng.standard_normal(n), Z


def both(s0: float, sn: float) -> tuple[BayesianLinear, ExactGP]:
    gp = ExactGP(Linear((0, 1, 2, 3)), np.full(4, np.log(s0)), np.log(sn))
    return BayesianLinear(Columns(), np.log(s0), np.log(sn)), gp


@pytest.mark.parametrize("n", [1, 3, 4, 40])
def test_it_is_the_process_with_the_linear_kernel(n: int) -> None:
    X, y, Z = data(n)
    regression, gp = both(1.5, 0.2)
    one, two = regression.condition(X, y), gp.condition(X, y)
    np.testing.assert_allclose(one.predict(Z), two.predict(Z), rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(one.covariance(Z, X), two.covariance(Z, X), atol=1e-10)
    assert one.signal_variance == pytest.approx(two.signal_variance)
    assert one.noise_variance == pytest.approx(two.noise_variance)
    value, gradient = regression.log_marginal_likelihood(X, y)
    expected, by_gp = gp.log_marginal_likelihood(X, y)
    assert value == pytest.approx(expected, rel=1e-8)
    np.testing.assert_allclose(gradient, [by_gp[:4].sum(), by_gp[4]], rtol=1e-7, atol=1e-8)


def test_inputs_at_a_million_and_almost_no_noise() -> None:
    X, y, Z = data(30, 1e6)
    posterior = BayesianLinear(Columns(), np.log(1e-6), np.log(0.1)).condition(X, y)
    np.testing.assert_allclose(posterior.predict(Z)[0], Z @ [1e-6, -2e-6, 0.0, 0.5e-6], atol=0.2)
    exact = BayesianLinear(Columns(), 0.0, np.log(1e-12)).condition(X, X @ np.ones(4))
    np.testing.assert_allclose(exact.weights, np.ones(4), rtol=1e-10)
    assert np.isfinite(exact.predict(Z)[1]).all()


def test_duplicate_rows_and_constant_outputs() -> None:
    X = np.ones((5, 4))
    mean, variance = both(1.0, 0.1)[0].condition(X, np.full(5, 2.0)).predict(np.eye(4))
    np.testing.assert_allclose(mean, 2.0 / 4.0, rtol=1e-2)
    np.testing.assert_allclose(variance, 0.75, rtol=1e-2)  # one direction of four is known


def test_what_it_refuses() -> None:
    regression, X, y = both(1.0, 0.1)[0], np.ones((3, 4)), np.zeros(3)
    with pytest.raises(DataError, match=r"inputs \(n, D\)"):
        regression.condition(X[:0], y[:0])
    with pytest.raises(DataError, match="NaN"):
        regression.condition(X, y + np.nan)
    with pytest.raises(UsageError, match=r"shape \(T, 4\)"):
        regression.condition(X, y).predict(np.ones((2, 3)))
    with pytest.raises(UsageError, match=r"expected log amplitude and log noise.*\(3,\)"):
        regression.with_parameters(np.zeros(3))
    with pytest.raises(UsageError, match="must be finite"):
        replace(regression, log_noise=-np.inf)

    class Broken(Columns):
        def transform(self, X: np.ndarray) -> np.ndarray:
            return X * np.inf

    with pytest.raises(NumericalError, match="not finite"):
        BayesianLinear(Broken(), 0.0, 0.0).condition(X, y)


@pytest.fixture(scope="module")
def regressors() -> tuple[BaseRegressor, ...]:
    model = mujoco.MjModel.from_xml_string(AWKWARD)
    tree = tree_from_mujoco(model, NAMES)
    return base_regressors(awkward_spec(), tree, drives_from_mujoco(model, NAMES), np.full(5, 0.03))


def inputs(n: int) -> np.ndarray:
    _, *motion = smooth_motion(np.random.default_rng(3), n, len(NAMES))
    return np.concatenate([*motion, np.ones((n, 2))], axis=1)


def test_gradient_of_the_regressor(regressors) -> None:
    """Hinges, a slide, a drive between sites and one that couples joints, against differences of its own."""
    X, rng = inputs(4), np.random.default_rng(0)
    for regressor in regressors:
        G = rng.standard_normal(regressor.transform(X).shape)
        gradient = regressor.pullback(X, G)
        assert np.all(gradient[:, -2:] == 0.0)
        direction = rng.standard_normal(X.shape)
        step = 1e-5
        near, far = (
            np.sum(G * (regressor.transform(X + h * direction) - regressor.transform(X - h * direction)))
            for h in (step, 2 * step)
        )
        assert np.sum(gradient * direction) == pytest.approx((8 * near - far) / (12 * step), rel=1e-7)


def test_every_inertial_parameter_acts_through_the_features(regressors) -> None:
    X, robot = inputs(400), regressors[0].motion
    motion = np.split(X[:, :15], 3, axis=1)
    rigid, extra = command_regressors(robot.tree, robot.drives, robot.friction_velocity, *motion)
    for j, regressor in enumerate(regressors):
        phi = regressor.transform(X)
        for columns in (rigid[:, j], extra[:, j]):
            command = columns @ np.random.default_rng(j).standard_normal(columns.shape[1])
            fitted = phi @ np.linalg.lstsq(phi, command, rcond=None)[0]
            np.testing.assert_allclose(fitted, command, atol=1e-6 * np.abs(command).max())


def test_prior_deviations_fill_the_command_limit(regressors) -> None:
    """The nominal model and each drive or friction term, over states that fill the robot's limits."""
    spec = awkward_spec()
    spread = np.concatenate(spread_states(spec, 64 + 24 * regressors[0].motion.tree.bodies), axis=1)
    for regressor in regressors:
        size = np.sqrt(np.mean(regressor.transform(spread) ** 2, axis=0))
        np.testing.assert_allclose(size[[0, *range(-6, 0)]], spec.command[0], rtol=1e-9)


def test_answers_kept_are_those_of_the_inputs_asked_for(regressors) -> None:
    X, Z, G = inputs(4), inputs(4) + 0.1, np.ones(regressors[0].transform(inputs(4)).shape)
    first = [regressors[0].transform(X), regressors[0].pullback(X, G)]
    assert not np.allclose(regressors[0].transform(Z), first[0])
    assert not np.allclose(regressors[0].pullback(Z, G), first[1])
    np.testing.assert_array_equal(regressors[0].transform(X), first[0])
    np.testing.assert_array_equal(regressors[0].pullback(X, G), first[1])
