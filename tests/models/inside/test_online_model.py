"""A model that learns on line: what reaches its learners, when, and what drives the robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from online_examples import CHANNELS, LIMITS, SMALL, SPEC, of_structure, trained

from etude.errors import DataError, UsageError
from etude.models import LearnedModel
from etude.models.selection.linear import LinearMean
from etude.types import Channel, Log, Motion
from etude_online import OnlineConfig, OnlineModel

RATE = 100.0
CONFIG = OnlineConfig("variance", size=40)


@pytest.fixture(scope="module")
def model() -> LearnedModel:
    return trained()


def started(
    model: LearnedModel, config: OnlineConfig = CONFIG, channels: dict[str, Channel] = CHANNELS
) -> OnlineModel:
    rng = np.random.default_rng(1)
    return OnlineModel(model, list(channels.values()), None, LIMITS, config, RATE, rng)


def swing(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position (T, 2) and a command that the first model cannot know."""
    q = np.column_stack([np.sin(0.7 * t), 0.8 * np.cos(0.9 * t)])
    return q, np.column_stack([12.0 * np.cos(q[:, 0]), 4.0 + q[:, 1]])


def ticks(seconds: float, first: float = 0.0) -> list[tuple[float, dict[str, np.ndarray]]]:
    """What a robot measures on the swing."""
    t = first + np.arange(round(seconds * RATE)) / RATE
    return [(now, {"q": q, "command": u}) for now, q, u in zip(t.tolist(), *swing(t), strict=True)]


def driven(online: OnlineModel, seconds: float, first: float = 0.0) -> np.ndarray:
    """(T,) samples learned in each tick."""
    counts = []
    for tick in ticks(seconds, first):
        online.observe(*tick)
        counts.append(online.counts.learned.sum())
    return np.diff([0, *counts])


def planned(t: float) -> dict[str, np.ndarray]:
    """The swing at one instant, with exact rates."""
    q = swing(np.array([t]))[0][0]
    qd = np.array([0.7 * np.cos(0.7 * t), -0.72 * np.sin(0.9 * t)])
    qdd = np.array([-0.49 * np.sin(0.7 * t), -0.648 * np.cos(0.9 * t)])
    return {"q": q, "qd": qd, "qdd": qdd}


def frozen(model: LearnedModel, t: float) -> np.ndarray:
    values = {name: row[None] for name, row in planned(t).items()}
    return model.mean(Log(np.array([t]), CHANNELS, values))[0]


def test_samples_come_late_at_their_rate_and_commands_take_turns(model) -> None:
    online = started(model, replace(CONFIG, hold_s=0.5))
    learned = driven(online, 4.0)
    # half a window, half a window more until it is full, and the hold
    assert 1.5 <= np.flatnonzero(learned)[0] / RATE <= 1.65
    assert learned.max() == 1
    # 10 Hz of each command after the first second and a half, but for joints that stand
    assert online.counts.learned.max() <= 26
    assert (online.counts.learned + online.counts.still >= 24).all()
    assert online.counts.refused.sum() == online.counts.ignored == 0


def test_what_is_learned_is_the_motion_in_the_middle_of_the_window(model, monkeypatch) -> None:
    online = started(model)
    seen = []
    for own in online.commands:
        monkeypatch.setattr(own.learner, "observe", lambda x, y, t, own=own: seen.append((own, x, y, t)))
    driven(online, 4.0)
    for own, x, y, t in seen:
        wanted, _ = model.inputs.step(planned(t), None)
        np.testing.assert_allclose(x[:4], wanted[:4], atol=0.01)
        np.testing.assert_allclose(x[4:6], wanted[4:6], atol=0.05)
        command = swing(np.array([t]))[1][0, own.place]
        assert own.offset + own.factor * y == pytest.approx(command, abs=0.1)
    assert len({t for *_, t in seen}) > 15


def test_what_is_judged_shares_no_measurement_with_what_was_learned(model, monkeypatch) -> None:
    online = started(model)
    newest, gaps, now = [-np.inf, -np.inf], [], [0.0]
    for j, own in enumerate(online.commands):
        monkeypatch.setattr(own.learner, "observe", lambda x, y, t, j=j: newest.__setitem__(j, t))
        monkeypatch.setattr(own.evidence, "judge", lambda f, u, j=j: gaps.append(now[0] - 0.5 - newest[j]))
    for t, row in ticks(5.0):
        now[0] = t
        online.observe(t, row)
    assert len(gaps) > 40
    assert min(gaps) >= 1.0 - 1e-9


def test_it_comes_to_drive_the_robot_where_it_is_better(model) -> None:
    online = started(model, replace(CONFIG, size=100, half_life=5.0))  # the start knows another robot
    np.testing.assert_allclose(online.command(30.0, planned(30.0))[0], frozen(model, 30.0))
    driven(online, 29.0)
    assert min(online.weights()) > 0.6
    errors = []
    for t in np.arange(5.0, 27.0, 0.5):
        wanted = swing(np.array([t]))[1][0]
        errors.append(np.abs([online.command(t, planned(t))[0] - wanted, frozen(model, t) - wanted]))
    after, before = np.mean(errors, axis=0)
    assert (after < 0.5 * before).all()


def test_a_plan_asked_for_ahead_says_what_its_rows_would() -> None:
    model = trained(replace(SMALL, candidates=("default",)))  # others remember, which takes a controller
    t = np.arange(500) / RATE
    rows = [planned(time) for time in t.tolist()]
    orders = np.stack([[row[name] for row in rows] for name in ("q", "qd", "qdd")])
    by_row, ahead = (started(model, replace(CONFIG, size=100, half_life=5.0)) for _ in range(2))
    assert ahead.planned(Motion(t, orders)) is None
    for online in (by_row, ahead):
        driven(online, 15.0)
    assert min(by_row.weights()) > 0.1
    for k in (0, 1, 250, 499):
        np.testing.assert_allclose(
            ahead.command(t[k], {})[0], by_row.command(t[k], rows[k])[0], rtol=1e-9, atol=1e-12
        )
    np.testing.assert_array_equal(ahead.command(-1.0, {})[0], ahead.command(0.0, {})[0])  # lead-in


def test_a_learner_that_is_worse_or_lost_its_numbers_does_not_drive(model, monkeypatch) -> None:
    online = started(model)
    for own in online.commands:
        monkeypatch.setattr(own.learner, "mean", lambda x: 1e6)
    driven(online, 10.0)
    assert np.abs(online.command(10.0, planned(10.0))[0] - frozen(model, 10.0)).max() < 0.1
    lost = started(model, replace(CONFIG, guarded=False))
    for own in lost.commands:
        monkeypatch.setattr(own.learner, "mean", lambda x: np.nan)
    assert lost.weights() == [1.0, 1.0]
    np.testing.assert_allclose(lost.command(10.0, planned(10.0))[0], frozen(model, 10.0))


def test_commands_are_finite_within_their_limits_and_the_same_when_replayed(model) -> None:
    narrow = -0.5 * np.ones(2), np.array([3.0, 4.0])
    runs = []
    for _ in range(2):
        rng = np.random.default_rng(5)
        online = OnlineModel(model, list(CHANNELS.values()), None, narrow, CONFIG, RATE, rng)
        rows = []
        for t, row in ticks(4.0):
            rows.append(np.concatenate(online.command(t, planned(t))))
            online.observe(t, row)
        runs.append(np.array(rows))
    np.testing.assert_array_equal(*runs)
    command, deviation = np.split(runs[0], 2, axis=1)
    assert (command >= narrow[0]).all()
    assert (command <= narrow[1]).all()
    assert ((command == narrow[0]) | (command == narrow[1])).any()
    assert (deviation > 0.0).all()
    assert np.isfinite(runs[0]).all()


def test_a_joint_at_rest_teaches_nothing(model) -> None:
    online = started(model)
    for t, row in ticks(4.0):
        online.observe(t, {**row, "q": np.array([row["q"][0], 0.3])})
    assert online.counts.learned[1] == 0
    assert online.counts.still[1] == online.counts.still.max() >= 25
    assert online.counts.learned[0] > 15


def test_broken_measurements_are_ignored_and_counted(model) -> None:
    clean, dirty = started(model), started(model)
    driven(clean, 4.0)
    for k, (t, row) in enumerate(ticks(4.0)):
        dirty.observe(t, row)
        if k == 250:
            dirty.observe(t, row)  # the clock stands still
            dirty.observe(0.5, {**row, "q": row["q"] + 9.0})  # and runs backwards, on a joint that jumps
    assert dirty.counts.ignored == 2  # there and back
    assert dirty.counts.rebased == 3
    assert abs(int(dirty.counts.learned.sum() - clean.counts.learned.sum())) <= 6  # the window fills anew
    assert dirty.counts.refused.sum() == 0
    dirty.observe(4.0, {"q": np.full(2, np.nan), "command": np.zeros(2)})
    assert dirty.counts.ignored == 3
    assert np.isfinite(dirty.command(4.0, planned(4.0))[0]).all()


def test_a_sample_that_a_learner_refuses_is_counted(model, monkeypatch) -> None:
    online = started(model)

    def refuse(x: np.ndarray, y: float, t: float) -> None:
        raise DataError("no")

    monkeypatch.setattr(online.commands[0].learner, "observe", refuse)
    driven(online, 4.0)
    assert online.counts.refused[0] > 10
    assert online.counts.learned[0] == 0
    assert online.counts.learned[1] > 10


def test_a_rate_that_is_measured_is_not_made_again(model) -> None:
    online = started(model)
    for t, row in ticks(3.0):
        online.observe(t, {**row, **planned(t), "q_des": np.full(2, 99.0), "unknown": np.zeros(1)})
    assert online.counts.learned.min() > 5
    with pytest.raises(UsageError, match="'q', which is neither"):
        started(model).observe(0.0, {"command": np.zeros(2)})


def test_physics_alone_are_what_a_learner_beside_them_is_held_against(model) -> None:
    """The regression drives; the process beside it learns, and is no part of the frozen model."""
    whole = trained(of_structure("linear"))
    assert set(whole.chosen) == {"linear"}
    assert set(whole.structures) == {"linear", "linear+gp"}
    online = started(whole)
    np.testing.assert_allclose(online.command(3.0, planned(3.0))[0], frozen(whole, 3.0))
    x, _ = whole.inputs.step(planned(3.0), None)
    states = Log(np.zeros(1), CHANNELS, {name: row[None] for name, row in planned(3.0).items()})
    for own in online.commands:
        assert isinstance(own.candidate.mean.original, LinearMean)
        said = own.base(states)[0] + own.factor * own.frozen(x)
        assert said == pytest.approx(frozen(whole, 3.0)[own.place])


def test_models_that_cannot_go_on_and_other_limits_are_refused(model) -> None:
    with pytest.raises(UsageError, match="process = 'exact' or a dictionary"):
        started(trained(of_structure("gp", process="vfe", basis=15, steps=2), count=1))
    limits = (-np.ones(3), np.ones(3))
    with pytest.raises(UsageError, match="the model has 2 commands"):
        OnlineModel(model, SPEC.channels(), None, limits, CONFIG, RATE, np.random.default_rng(0))
