"""What remains at rest, of every structure of the ladder and of the Lagrangian priors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from learning_examples import LIMIT, NAMES, PHYSICS, SMALL, Inputs, selection, trajectories

from etude.errors import UsageError
from etude.models import Folds, LearnedModel, fold_numbers, load_model, save_model
from etude.protocols import Candidate
from etude_lagrangian import all_lin, data_together
from etude_online import OnlineConfig
from etude_online.command import learning_command

Q = np.random.default_rng(0).uniform(-0.7, 0.7, (6, 2))
SAMPLES = trajectories(2)


def resting(model: LearnedModel) -> np.ndarray:
    """What the model says of a robot in the poses that neither moves nor begins to."""
    return model.predict({"q": Q, "qd": 0.0 * Q, "qdd": 0.0 * Q})[0]


@pytest.fixture(scope="module")
def together() -> LearnedModel:
    config = replace(SMALL, points=60, fit_points=40, steps=15)
    inputs = Inputs()
    fold = fold_numbers(SAMPLES, config.stretch_s)
    folds = Folds(SAMPLES, inputs, inputs.of_log(SAMPLES.log), fold, LIMIT, config, NAMES)
    data, units = data_together(folds, 0.002, None, np.random.default_rng(0))
    whole = Candidate("gp", (0, 1), np.ones(2), None, all_lin(data), units, np.ones(2))
    ranges = np.stack([folds.X.min(axis=0), folds.X.max(axis=0)])
    return LearnedModel(inputs, (whole,), NAMES, ranges, False, np.ones(2), member="all_lin")


def test_of_every_rung() -> None:
    model = selection(SAMPLES, replace(SMALL, rung="auto")).model
    assert len(model.structures) >= 5
    for structure in model.structures:
        own = model.of_structure(structure)
        np.testing.assert_allclose(own.gravity(Q), resting(own), rtol=1e-9, err_msg=structure)
    identified = PHYSICS["identified"](SAMPLES)
    wanted = 8.0 * np.cos(Q[:, 0]) + 1.2 * np.cos(Q.sum(axis=1))
    found = model.of_structure("identified").gravity(Q)[:, 0]
    np.testing.assert_allclose(found, wanted + identified.weights[2, 0], atol=0.5)


def test_of_a_lagrangian_prior_for_each_command() -> None:
    model = selection(SAMPLES, replace(SMALL, kernel="gip_lin")).model
    np.testing.assert_allclose(model.gravity(Q), resting(model), rtol=1e-9)
    wanted = 8.0 * np.cos(Q[:, 0]) + 1.2 * np.cos(Q.sum(axis=1)) + 0.5 * np.sin(8.0 * Q[:, 0])
    assert np.std(model.gravity(Q)[:, 0] - wanted) < 0.5 * np.std(wanted)


def test_of_one_energy_for_all_commands_also_when_read_again(together, tmp_path) -> None:
    np.testing.assert_allclose(together.gravity(Q), resting(together), rtol=1e-9)
    wanted = 8.0 * np.cos(Q[:, 0]) + 1.2 * np.cos(Q.sum(axis=1))
    assert np.std(together.gravity(Q)[:, 0] - wanted) < 0.6 * np.std(wanted)
    save_model(tmp_path / "model.npz", together)
    again = load_model(tmp_path / "model.npz", Inputs().restore, PHYSICS)
    np.testing.assert_array_equal(again.gravity(Q), together.gravity(Q))
    np.testing.assert_array_equal(again.predict(SAMPLES.log)[1], together.predict(SAMPLES.log)[1])
    assert [own for _, own in again.latents()] == [(0,), (1,)]


def test_one_energy_goes_on_learning_on_line_by_the_process_of_each_command(together) -> None:
    """The guard holds against what the model says; the learner begins with that command's own process."""
    X = together.inputs.of_log(SAMPLES.log)[:5]
    command = learning_command(together, 1, OnlineConfig("variance", size=60), np.random.default_rng(0))
    process = together.candidates[0].process
    np.testing.assert_allclose([command.frozen(x) for x in X], process.mean(X)[:, 1], rtol=1e-8)
    alone = process.latents()[1][0].predict(X)[0]
    np.testing.assert_allclose([command.learner.mean(x) for x in X], alone, atol=1e-4 * np.abs(alone).max())
    before = command.learner.mean(X[0])
    command.judge(0.0, X[0], before + 9.0, 0.0)
    assert command.learned(1.0) is not None


def test_poses_that_are_none_are_refused(together) -> None:
    with pytest.raises(UsageError, match=r"shape \(2,\), not \(n, 2\)"):
        together.gravity(Q[0])
    strange = replace(together, commands=("m1", "m2"))
    with pytest.raises(UsageError, match="not one position per command"):
        strange.gravity(Q)


def test_plain_arrays_of_a_moving_robot_are_taken_at_rest_too() -> None:
    """qd and qdd are rates of q by their names."""
    model = selection(SAMPLES, replace(SMALL, rung="auto")).model
    moving = {"q": Q, "qd": np.sin(Q), "qdd": 3.0 * np.cos(Q)}
    np.testing.assert_allclose(model.static(moving), model.gravity(Q), rtol=1e-9)
