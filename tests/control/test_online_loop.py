"""The closed loop that learns: an ordinary run without updates, a better one with them; robots may change."""

from __future__ import annotations

import numpy as np
import pytest
from test_closed_loop import Swing

from etude.control.closed_loop import run_closed_loop
from etude.control.feedforward import model_feedforward, no_feedforward
from etude.control.online_loop import OnlineRun, run_online
from etude.errors import UsageError
from etude.models.inverse_dynamics import InverseDynamicsModel, ModelConfig, train_model
from etude.models.online.learner import OnlineConfig
from etude.models.online.model import OnlineModel
from etude.models.preprocess import build_dataset, preset
from etude.plants.changes import with_friction
from etude.plants.parameters import load_parameters
from etude.plants.registry import simulated_robot

ROBOT = simulated_robot("arm4", "compiled")
SECONDS = 12.0
SMALL = ModelConfig(kind="gp", kernel="ard_se", points=60, fit_points=60, steps=8, calibrate=False)


@pytest.fixture(scope="module")
def model() -> InverseDynamicsModel:
    """Knows one slow swing."""
    log = run_closed_loop(ROBOT, Swing(ROBOT), no_feedforward(ROBOT.spec), np.random.default_rng(0))
    data = build_dataset(log, ROBOT.spec, preset("default"), 0)
    return train_model(data, ROBOT.spec, SMALL, np.random.default_rng(1))


def run(model: InverseDynamicsModel, method: str | None, passes: int = 2, **options: object) -> OnlineRun:
    online = None
    if method is not None:
        config = OnlineConfig(method, size=80, frequencies=20)
        online = OnlineModel(model, config, ROBOT.spec.rate, np.random.default_rng(2))
    motion = Swing(ROBOT, SECONDS)
    return run_online(ROBOT, motion, model, online, np.random.default_rng(3), passes, **options)


def test_without_updates_it_is_the_ordinary_closed_loop_to_the_bit(model) -> None:
    motion, feedforward = Swing(ROBOT, SECONDS), model_feedforward(model, ROBOT.spec)
    wanted = run_closed_loop(ROBOT, motion, feedforward, np.random.default_rng(3))
    found = run(model, None, passes=1).log
    for field in ("t", "q", "q_true", "tau", "tau_fb", "tau_ff", "q_des", "qd_des", "qdd_des"):
        np.testing.assert_array_equal(getattr(found, field), getattr(wanted, field), err_msg=field)


@pytest.mark.parametrize("method", ["variance", "error", "ssgp", "sogp"])
def test_with_updates_the_last_pass_is_better_than_without(model, method: str) -> None:
    without, learned = run(model, None), run(model, method)
    errors = [found.pass_errors().mean(axis=1) for found in (without, learned)]
    assert errors[1][-1] < 0.8 * errors[0][-1]
    assert errors[1][-1] < errors[1][0]
    assert (learned.weights >= 0.0).all()
    assert (learned.weights <= 1.0).all()
    assert (np.abs(learned.log.tau_ff) <= ROBOT.spec.command).all()
    assert learned.learned.sum() > 200
    assert (learned.update_s[learned.learned] > 0.0).all()


def test_the_same_seed_gives_the_same_run(model) -> None:
    one, same = (run(model, "ssgp", passes=1) for _ in range(2))
    np.testing.assert_array_equal(one.log.q_true, same.log.q_true)
    np.testing.assert_array_equal(one.weights, same.weights)


def test_a_robot_that_changes_is_as_before_until_then(model) -> None:
    heavier = with_friction(load_parameters("arm4"), 1.5)
    runs = [run(model, None, passes=1, changes=change) for change in (None, {6.0: heavier})]
    before = runs[0].log.t <= 6.0
    q = [found.log.q_true for found in runs]
    np.testing.assert_array_equal(q[0][before], q[1][before])
    assert np.abs(q[0] - q[1]).max() > 0.005


def test_pass_errors_are_means_over_each_pass(model) -> None:
    found = run(model, None)
    error = np.abs(found.log.q_des - found.log.q_true)[found.log.t >= 0.0]
    np.testing.assert_allclose(found.pass_errors(), [error[:1200].mean(axis=0), error[1200:].mean(axis=0)])


def test_refusals(model) -> None:
    motion = Swing(ROBOT, SECONDS)
    with pytest.raises(UsageError, match='Use "compiled"'):
        run_online(simulated_robot("arm4", "mujoco"), motion, model, None, None)
    with pytest.raises(UsageError, match="0 passes"):
        run_online(ROBOT, motion, model, None, None, passes=0)
    motion.dof = 3
    with pytest.raises(UsageError, match="of 3 joints"):
        run_online(ROBOT, motion, model, None, None)
