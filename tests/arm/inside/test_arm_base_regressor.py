"""The identified model's regressor as features of a linear regression: its gradient, reach and scale."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from rigid_examples import AWKWARD, NAMES, awkward_spec, smooth_motion

from etude_arm.physics.base_parameters import spread_states
from etude_arm.physics.base_regressor import BaseRegressor, base_regressors
from etude_arm.physics.rigid_body import command_regressors
from etude_arm.physics.rigid_tree import drives_from_mujoco, tree_from_mujoco


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
