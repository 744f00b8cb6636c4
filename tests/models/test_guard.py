"""The guard: where a process would lose to linear regression on unseen motion, the guarded model does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from etude.control.feedforward import model_feedforward
from etude.models.blocks import linear_regression
from etude.models.dataset import Dataset, concatenate
from etude.models.guard import linear_errors, linear_inputs
from etude.models.inverse_dynamics import InverseDynamicsModel, train_model
from etude.models.model_file import load_model, save_model
from etude.trajectories.samples import TrajectorySamples
from learning_examples import SMALL, pendulum, trajectories, trajectory

from etude.models.held_out import held_out_groups

BARE = replace(SMALL, guard=False)


def drifting(count: int = 3, beyond: float = 0.0, size: float = 1.0) -> Dataset:
    """Each trajectory around a posture of its own; command 0 is linear in it, 1 is that of the robot."""
    parts = []
    for g in range(count):
        own = trajectory(g)
        q = 0.3 * own.q + 0.7 * g + beyond
        noise = 0.05 * np.random.default_rng(g).normal(size=len(q))
        tau = np.column_stack([size * (10.0 * q[:, 0] - 4.0 * own.qdd[:, 1] + noise), own.tau[:, 1]])
        parts.append(replace(own, q=q, tau=tau, stuck=np.zeros_like(own.stuck)))
    return concatenate(parts)


def train(data: Dataset, config=SMALL, spec=None) -> InverseDynamicsModel:
    return train_model(data, spec or pendulum(), config, np.random.default_rng(0))


def ratios(model: InverseDynamicsModel, data: Dataset, test: Dataset) -> np.ndarray:
    """Squared error over that of linear regression, per output."""
    mean, _ = model.predict(test.q, test.qd, test.qdd)
    linear = linear_regression(data, test)
    return ((mean - test.tau) ** 2).mean(axis=0) / ((linear - test.tau) ** 2).mean(axis=0)


@pytest.mark.parametrize("size", [1.0, 1e-7, 1e7], ids=["plain", "tiny", "huge"])
def test_a_trend_beyond_the_data_is_where_a_process_loses_and_the_guard_does_not(size: float) -> None:
    data, test = drifting(size=size), drifting(1, beyond=3.0, size=size)
    assert ratios(train(data, BARE), data, test)[0] > 100.0
    guarded = train(data)
    assert guarded.guard is not None
    assert guarded.guard.roles[0] != "process"
    assert ratios(guarded, data, test)[0] < 1.1
    assert guarded.guard.process_error[0] > guarded.guard.linear_error[0]


def test_what_was_compared_is_a_trajectory_predicted_from_the_others() -> None:
    data = drifting()
    guard = train(data).guard
    assert guard is not None
    model = train(data, BARE)
    rows = np.flatnonzero(np.isin(data.q[:, 0], model.posteriors[0].X[:, 0]))
    L = linear_inputs(data.q, data.qd, data.qdd)
    errors = np.empty(len(rows))
    for number in range(3):
        fit = data.take(data.group != number)
        weights = np.linalg.lstsq(linear_inputs(fit.q, fit.qd, fit.qdd), fit.tau[:, 0], rcond=None)[0]
        own = data.group[rows] == number
        errors[own] = data.tau[rows[own], 0] - L[rows[own]] @ weights
    np.testing.assert_allclose(linear_errors(L, data.tau[:, 0], data.group, rows), errors)
    assert guard.linear_error[0] == pytest.approx(np.mean(errors**2))
    mean, _ = model.posteriors[0].leave_group_out(data.group[rows])
    target = data.tau[rows, 0] - model.offset[0]
    assert guard.process_error[0] == pytest.approx(np.mean((target - mean) ** 2))


def test_a_process_that_predicts_better_is_left_as_it_was() -> None:
    data = trajectories(3)
    guarded, bare = train(data), train(data, BARE)
    assert guarded.guard is None
    for mine, theirs in zip(
        guarded.predict(data.q, data.qd, data.qdd), bare.predict(data.q, data.qd, data.qdd), strict=True
    ):
        np.testing.assert_array_equal(mine, theirs)


def test_a_constant_command_is_predicted_as_well_as_by_linear_regression() -> None:
    data, test = trajectories(3), trajectory(7)
    data, test = (replace(d, tau=np.column_stack([np.full(len(d), 2.5), d.tau[:, 1]])) for d in (data, test))
    mean, variance = train(data).predict(test.q, test.qd, test.qdd)
    assert np.abs(mean[:, 0] - 2.5).max() < 1e-9
    assert np.all(variance > 0.0)


def test_a_linear_command_under_noise_as_large_as_itself_is_guarded_too() -> None:
    data, test = drifting(4), drifting(1, beyond=3.0)
    rng = np.random.default_rng(3)
    noisy, measured = (
        replace(d, tau=d.tau + np.array([8.0, 0.0]) * rng.normal(size=d.tau.shape)) for d in (data, test)
    )
    assert ratios(train(noisy, BARE), noisy, measured)[0] > 1.5
    assert ratios(train(noisy), noisy, measured)[0] < 1.1


def test_linear_alone_predicts_what_linear_regression_does_with_an_honest_variance() -> None:
    data, test = drifting(), drifting(1, beyond=3.0)
    model = train(data)
    assert model.guard is not None
    alone = replace(model.guard, roles=("linear", "process"))
    model = replace(model, guard=alone)
    mean, variance = model.predict(test.q, test.qd, test.qdd)
    np.testing.assert_allclose(mean[:, 0], model.guard.linear(test.q, test.qd, test.qdd)[:, 0])
    assert np.all(variance[:, 0] >= model.guard.linear_error[0])
    assert np.all(np.isfinite(mean))


def test_without_anything_held_out_nothing_is_guarded() -> None:
    data = drifting(2)
    assert train(data, replace(SMALL, guard=False, calibrate=False)).guard is None
    groups = held_out_groups(trajectory(0, seconds=6.0))
    assert len(np.unique(groups)) == 4  # a short log too is held out in stretches
    assert len(np.unique(held_out_groups(trajectory(0, seconds=80.0)))) == 10


def test_every_member_is_guarded() -> None:
    data, test = drifting(), drifting(1, beyond=3.0)
    for process in ("vfe", "sogp"):  # a dictionary takes the same way, and seconds to compile
        model = train(data, replace(SMALL, process=process, points=60, basis=30, steps=6))
        assert model.guard is not None, process
        assert ratios(model, data, test)[0] < 1.1, process


def test_a_guarded_model_on_disk_predicts_the_same_and_keeps_its_message(tmp_path) -> None:
    data, test = drifting(), drifting(1, beyond=1.0)
    model = train(data)
    save_model(model, tmp_path)
    again = load_model(tmp_path)
    assert again.guard is not None
    assert model.guard is not None
    for mine, theirs in zip(
        again.predict(test.q, test.qd, test.qdd), model.predict(test.q, test.qd, test.qdd), strict=True
    ):
        np.testing.assert_allclose(mine, theirs, rtol=1e-9, atol=1e-9)
    (message,) = model.guard.messages(("a", "b"))
    assert message == again.guard.messages(("a", "b"))[0]
    assert message.startswith("a: on motion held out the process erred")
    assert "linear regression" in message


def test_a_physical_model_is_guarded_too(tmp_path) -> None:
    spec = pendulum(tmp_path)
    data, test = drifting(), drifting(1, beyond=3.0)
    model = train(data, replace(SMALL, kind="identified+gp"), spec)
    assert ratios(model, data, test)[0] < 1.5


def test_feedforward_of_a_guarded_model_is_finite() -> None:
    data = drifting()
    own = data.take(data.group == 0)
    samples = TrajectorySamples(own.t, own.q, own.qd, own.qdd, np.zeros_like(own.q))
    command = model_feedforward(train(data), pendulum())(samples)
    assert command.shape == own.q.shape
    assert np.all(np.isfinite(command))


def test_one_trajectory_is_warned_of_and_not_guarded() -> None:
    """Stretches of one motion say little of the next, on which linear regression may err without bound."""
    t = np.arange(0.0, 60.0, 0.125)
    one = trajectory(0, seconds=60.0)
    q = np.column_stack([0.1 * t, one.q[:, 1]])
    data = replace(
        one, q=q, tau=np.column_stack([10.0 * q[:, 0], one.tau[:, 1]]), stuck=np.zeros_like(one.stuck)
    )
    guarded, bare = train(data), train(data, BARE)
    assert guarded.guard is not None
    assert guarded.guard.roles[0] == "unsure"
    assert "tell another one" in guarded.warnings(("a", "b"))[0]
    motion = (data.q, data.qd, data.qdd)
    np.testing.assert_array_equal(guarded.predict(*motion)[0], bare.predict(*motion)[0])
    np.testing.assert_array_equal(guarded.predict(*motion)[1], bare.predict(*motion)[1])
