"""The closed loop that learns: an ordinary run without updates, a better one with them; robots may change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from etude.errors import UsageError
from etude.models import LearnedModel, ModelConfig
from etude.types import Motion
from etude_online import OnlineConfig
from etude_studies import online
from etude_studies.online_run import OnlineRun, Repeated
from etude_studies.world import World

WORLD = World.of("arm4")
SECONDS = 12.0
SMALL = ModelConfig(rung="gp", kernel="ard_se", points=60, fit_points=60, steps=8, calibrate=False)


class Swing:
    """Every joint swings about its middle at 0.6 of its range, one sine each; starts and ends at rest."""

    form = "swing"

    def __init__(self, duration: float = 40.0) -> None:
        spec = WORLD.spec
        self.duration = duration
        self.middle, self.width = 0.5 * (spec.lower + spec.upper), 0.3 * (spec.upper - spec.lower)
        self.omega = 2.0 * np.pi / duration * np.array([1, 2, 2, 2])

    def motion(self, t: np.ndarray, orders: int = 3) -> Motion:
        angle = self.omega * t[:, None]
        q = self.middle - self.width * np.cos(angle)
        qd, qdd = self.width * self.omega * np.sin(angle), self.width * self.omega**2 * np.cos(angle)
        return Motion(t, np.stack([q, qd, qdd])[:orders])


@pytest.fixture(scope="module")
def model() -> LearnedModel:
    """Knows one slow swing."""
    log = WORLD.robot.run(Swing(), None, np.random.default_rng(0))
    return WORLD.learned(WORLD.samples(log), SMALL, np.random.default_rng(1)).model


def run(model: LearnedModel, method: str | None, passes: int = 2, **change: float) -> OnlineRun:
    config = None if method is None else OnlineConfig(method, size=80, frequencies=20)
    changes = {6.0: WORLD.robot.changed(**change)} if change else {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(online, "PASSES", passes)
        return online.run_rule(WORLD, model, Swing(SECONDS), config, 3, changes)


def errors(found: OnlineRun) -> np.ndarray:
    return np.array([WORLD.robot.error(part)[0].mean() for part in found.passes()])


def test_without_updates_it_is_the_ordinary_closed_loop_to_the_bit(model) -> None:
    controller = WORLD.kind.controller(WORLD.spec, WORLD.config, model)
    wanted = WORLD.robot.run(Swing(SECONDS), controller, np.random.default_rng([3, 2]))
    found = run(model, None, passes=1).log
    assert list(found.values) == list(wanted.values)
    np.testing.assert_array_equal(found.t, wanted.t)
    for name, values in wanted.values.items():
        np.testing.assert_allclose(found[name], values, rtol=0.0, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("method", ["variance", "error", "ssgp", "sogp"])
def test_with_updates_the_last_pass_is_better_than_without(model, method: str) -> None:
    without, learned = run(model, None), run(model, method)
    before, after = errors(without), errors(learned)
    assert after[-1] < 0.8 * before[-1]
    assert after[-1] < after[0]
    watched = learned.watched
    assert watched is not None
    assert len(watched.weights) == len(learned.log)
    assert (watched.weights >= 0.0).all()
    assert (watched.weights <= 1.0).all()
    assert (np.abs(learned.log["command_ff"]) <= WORLD.spec.command).all()
    assert watched.learned.sum() > 200
    assert watched.learned.max() == 1
    assert (watched.times("observe")[watched.learned > 0] > 0.0).all()


def test_a_learner_without_weight_leaves_the_ordinary_run(model, monkeypatch) -> None:
    monkeypatch.setattr("etude_online.command.UpdateWeight.judge", lambda *_: None)
    held, without = run(model, "variance", passes=1), run(model, None, passes=1)
    for name, values in without.log.values.items():
        np.testing.assert_array_equal(held.log[name], values, err_msg=name)


def test_the_same_seed_gives_the_same_run(model) -> None:
    one, same = (run(model, "ssgp", passes=1) for _ in range(2))
    np.testing.assert_array_equal(one.log["q_true"], same.log["q_true"])
    assert one.watched is not None
    assert same.watched is not None
    np.testing.assert_array_equal(one.watched.weights, same.watched.weights)


@pytest.mark.parametrize("method", [None, "variance"])
def test_a_robot_that_changes_is_as_before_until_then(model, method: str | None) -> None:
    runs = [run(model, method, passes=1), run(model, method, passes=1, friction=1.5)]
    before = runs[0].log.t <= 6.0
    q = [found.log["q_true"] for found in runs]
    np.testing.assert_array_equal(q[0][before], q[1][before])
    assert np.abs(q[0] - q[1]).max() > 0.005


def test_errors_are_means_over_each_pass(model) -> None:
    found = run(model, None)
    error = np.abs(found.log["q_des"] - found.log["q_true"])[found.log.t >= 0.0]
    wanted = np.rad2deg([error[:1200].mean(axis=0), error[1200:].mean(axis=0)])
    np.testing.assert_allclose([WORLD.robot.error(part)[0] for part in found.passes()], wanted)


def test_a_repeated_motion_is_the_motion_in_every_pass() -> None:
    once = Swing(SECONDS)
    thrice = Repeated(once, 3)
    t = np.arange(round(100 * SECONDS)) / 100.0
    assert thrice.duration == 3 * SECONDS
    assert [start for start, *_ in thrice.pieces()] == [0.0, 12.0, 24.0]
    for number in range(3):
        later = thrice.motion(t + number * SECONDS)
        np.testing.assert_allclose(later.orders, once.motion(t).orders, atol=1e-12)
    with pytest.raises(UsageError, match="0 passes"):
        Repeated(once, 0)


def test_an_engine_that_cannot_go_tick_by_tick_is_refused(model) -> None:
    slow = replace(WORLD.robot, engine="mujoco")
    with pytest.raises(UsageError, match='Use "compiled"'):
        slow.run(Swing(SECONDS), None, None, changes={1.0: slow})
