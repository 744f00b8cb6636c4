"""A model that learns on line: what reaches its learners, when, and what drives the robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from etude.models.inverse_dynamics import InverseDynamicsModel, train_model
from learning_examples import SMALL, pendulum, trajectories, trajectory

from etude.errors import DataError, UsageError
from etude.models.online.learner import OnlineConfig
from etude.models.online.model import OnlineModel

RATE = 100.0
CONFIG = OnlineConfig("variance", size=40)


@pytest.fixture(scope="module")
def model() -> InverseDynamicsModel:
    config = replace(SMALL, steps=5, calibrate=False)
    return train_model(trajectories(2), pendulum(), config, np.random.default_rng(0))


def started(model: InverseDynamicsModel, config: OnlineConfig = CONFIG) -> OnlineModel:
    return OnlineModel(model, config, RATE, np.random.default_rng(1))


def swing(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position (T, 2) and a command that the first model cannot know."""
    q = np.column_stack([np.sin(0.7 * t), 0.8 * np.cos(0.9 * t)])
    return q, np.column_stack([12.0 * np.cos(q[:, 0]), 4.0 + q[:, 1]])


def driven(online: OnlineModel, seconds: float, first: float = 0.0) -> list[int]:
    t = first + np.arange(round(seconds * RATE)) / RATE
    return [online.observe(*row) for row in zip(t, *swing(t), strict=True)]


def at(online: OnlineModel, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Features, mean function and frozen command (each of one instant) on the swing, with exact rates."""
    q = swing(np.array([t]))[0]
    qd = np.array([[0.7 * np.cos(0.7 * t), -0.72 * np.sin(0.9 * t)]])
    qdd = np.array([[-0.49 * np.sin(0.7 * t), -0.648 * np.cos(0.9 * t)]])
    motion = (q, qd, qdd)
    frozen = online.model.predict(*motion)[0][0]
    return online.model.features.transform(*motion)[0], online.model.mean_function(*motion)[0], frozen


def test_samples_come_late_at_their_rate_and_outputs_take_turns(model) -> None:
    online = started(model, replace(CONFIG, hold_s=0.5))
    learned = driven(online, 4.0)
    first = next(k for k, count in enumerate(learned) if count)
    # half a window, half a window more until it is full, and the hold
    assert 1.5 <= first / RATE <= 1.65
    assert max(learned) == 1
    assert sum(learned) == online.counts.learned.sum()
    # 10 Hz of each output after the first second and a half, but for stuck samples
    assert online.counts.learned.max() <= 26
    assert (online.counts.learned + online.counts.stuck >= 24).all()
    assert online.counts.refused.sum() == online.counts.ignored == 0


def test_what_is_learned_is_the_motion_in_the_middle_of_the_window(model, monkeypatch) -> None:
    online = started(model)
    seen = []
    for learner in online.learners:
        monkeypatch.setattr(learner, "observe", lambda x, y, t: seen.append((x, y, t)))
    driven(online, 4.0)
    for x, y, t in seen:
        wanted_x, base, _ = at(online, t)
        np.testing.assert_allclose(x[:4], wanted_x[:4], atol=0.01)
        np.testing.assert_allclose(x[4:6], wanted_x[4:6], atol=0.05)
        command = swing(np.array([t]))[1][0]
        assert np.abs(command - base - y).min() < 0.1
    assert len({t for _, _, t in seen}) > 15


def test_what_is_judged_shares_no_measurement_with_what_was_learned(model, monkeypatch) -> None:
    online = started(model)
    newest, gaps = [-np.inf, -np.inf], []
    for j, (learner, guard) in enumerate(zip(online.learners, online.guards, strict=True)):
        monkeypatch.setattr(learner, "observe", lambda x, y, t, j=j: newest.__setitem__(j, t))
        monkeypatch.setattr(guard, "judge", lambda f, u, j=j: gaps.append(now[0] - 0.5 - newest[j]))
    now = [0.0]
    t = np.arange(500) / RATE
    for row in zip(t, *swing(t), strict=True):
        now[0] = row[0]
        online.observe(*row)
    assert len(gaps) > 40
    assert min(gaps) >= 1.0 - 1e-9


def test_it_comes_to_drive_the_robot_where_it_is_better(model) -> None:
    online = started(model, replace(CONFIG, size=100, half_life=5.0))  # the start knows another robot
    x, base, frozen = at(online, 30.0)
    np.testing.assert_array_equal(online.command(x, base, frozen), frozen)
    driven(online, 29.0)
    assert min(online.weights()) > 0.6
    errors = []
    for t in np.arange(5.0, 27.0, 0.5):
        x, base, frozen = at(online, t)
        wanted = swing(np.array([t]))[1][0]
        errors.append(np.abs([online.command(x, base, frozen) - wanted, frozen - wanted]))
    after, before = np.mean(errors, axis=0)
    assert (after < 0.5 * before).all()


def test_a_learner_that_is_worse_or_lost_its_numbers_does_not_drive(model, monkeypatch) -> None:
    online = started(model)
    for learner in online.learners:
        monkeypatch.setattr(learner, "mean", lambda x: 1e6)
    driven(online, 10.0)
    x, base, frozen = at(online, 10.0)
    assert np.abs(online.command(x, base, frozen) - frozen).max() < 0.1
    lost = started(model, replace(CONFIG, guarded=False))
    for learner in lost.learners:
        monkeypatch.setattr(learner, "mean", lambda x: np.nan)
    assert lost.weights() == [1.0, 1.0]
    np.testing.assert_array_equal(lost.command(x, base, frozen), frozen)


def test_a_joint_at_rest_teaches_nothing(model) -> None:
    online = started(model)
    t = np.arange(400) / RATE
    q, tau = swing(t)
    q[:, 1] = 0.3
    for row in zip(t, q, tau, strict=True):
        online.observe(*row)
    assert online.counts.learned[1] == 0
    assert online.counts.stuck[1] == online.counts.stuck.max() >= 25
    assert online.counts.learned[0] > 15


def test_broken_measurements_are_ignored_and_counted(model) -> None:
    clean, dirty = started(model), started(model)
    driven(clean, 4.0)
    t = np.arange(400) / RATE
    for k, row in enumerate(zip(t, *swing(t), strict=True)):
        dirty.observe(*row)
        if k == 250:
            dirty.observe(*row)  # the clock stands still
            dirty.observe(0.5, row[1] + 9.0, row[2])  # and runs backwards
    assert dirty.counts.ignored == 2
    assert abs(int(dirty.counts.learned.sum() - clean.counts.learned.sum())) <= 2
    assert dirty.counts.refused.sum() == 0
    dirty.observe(4.0, np.full(2, np.nan), np.zeros(2))
    assert dirty.counts.ignored == 3
    x, base, frozen = at(dirty, 4.0)
    assert np.isfinite(dirty.command(x, base, frozen)).all()


def test_a_sample_that_a_learner_refuses_is_counted(model, monkeypatch) -> None:
    online = started(model)

    def refuse(x: np.ndarray, y: float, t: float) -> None:
        raise DataError("no")

    monkeypatch.setattr(online.learners[0], "observe", refuse)
    driven(online, 4.0)
    assert online.counts.refused[0] > 10
    assert online.counts.learned[0] == 0
    assert online.counts.learned[1] > 10


def test_models_that_cannot_go_on_are_refused(model) -> None:
    with pytest.raises(UsageError, match="kind 'identified'"):
        started(replace(model, kind="identified"))
    data = trajectory(0)
    config = replace(SMALL, process="vfe", basis=15, steps=2, calibrate=False)
    other = train_model(data, pendulum(), config, np.random.default_rng(0))
    with pytest.raises(UsageError, match="process = 'exact' or a dictionary"):
        started(other)
