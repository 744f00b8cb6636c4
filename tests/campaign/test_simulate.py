"""The simulated loop, with a model that costs nothing: what is run, tested, committed and not repeated."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from etude.campaign import simulate as module
from etude.campaign.create import create_campaign
from etude.campaign.folder import Campaign, open_campaign
from etude.campaign.learner import Learned
from etude.campaign.simulate import simulate
from etude.campaign.simulate import test_motions as motions_of
from etude.errors import UsageError
from etude.trajectories.certificate import certify
from etude.trajectories.random import random_trajectory

CONFIG = "seed = 4\n[trajectory]\nduration = 8.0\n"


class Spring:
    """A model that knows nothing but is sure of it."""

    prior_deviation = np.ones(4)

    def predict(self, q: Any, qd: Any, qdd: Any) -> tuple[Any, Any]:
        return np.zeros_like(q), np.zeros_like(q)


@pytest.fixture
def arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Campaign:
    def learn(campaign: Campaign, state: Any, number: int) -> Learned:
        return Learned([], {"models": {}, "chosen": "gp", "robot_seconds": 8.0 * number})

    def again(_: Any, campaign: Campaign, __: Any, rng: np.random.Generator, ___: Any) -> Any:
        return random_trajectory(rng, campaign.spec, campaign.config.trajectory), {"status": "", "gain": None}

    monkeypatch.setattr("etude.campaign.ladder_learner.learn_ladder", learn)
    monkeypatch.setattr("etude.campaign.joint_kind.JointKind.design", again)
    monkeypatch.setattr(module, "newest_model", lambda *_: Spring())
    monkeypatch.setattr("etude.campaign.ask.newest_model", lambda *_: Spring())
    monkeypatch.setattr(module, "_identified", lambda *_: None)
    monkeypatch.setattr(module, "MOVES", 1)
    path = create_campaign(tmp_path / "lab", "arm4", seed=4)[0].path
    (path / "campaign.toml").write_text(CONFIG)
    return open_campaign(path)


def test_rounds_tests_and_baselines(arm: Campaign) -> None:
    done = list(simulate(arm, 2))
    assert [r.number for r in done] == [1, 2]
    assert [round(r.robot_seconds) for r in done] == [8, 16]
    evaluated = arm.state().evaluated
    keys = [(e["number"], e.get("baseline"), e["test"]) for e in evaluated]
    assert len(set(keys)) == len(keys) == 8
    by = {key: np.mean(e["tracking_error_deg"]) for key, e in zip(keys, evaluated, strict=True)}
    assert by[0, "perfect", "fourier"] < 0.3 * by[0, "pd", "fourier"]
    # a model that says 0 is PD alone
    assert by[1, None, "fourier"] == pytest.approx(by[0, "pd", "fourier"])


def test_going_on_repeats_nothing(arm: Campaign) -> None:
    list(simulate(arm, 1))
    before = arm.events()
    assert list(simulate(arm, 0)) == []
    assert arm.events() == before
    assert [r.number for r in simulate(arm, 1)] == [2]
    assert arm.events()[: len(before)] == before


def test_an_interrupted_test_is_made_up_for(arm: Campaign) -> None:
    next(iter(simulate(arm, 1)))
    lines = (arm.path / "journal.jsonl").read_text().splitlines(keepends=True)
    assert '"evaluated"' in lines[-1]
    (arm.path / "journal.jsonl").write_text("".join(lines[:-1]))
    list(simulate(arm, 0))
    assert len(arm.events()) == len(lines)


def test_a_log_left_unlearned_is_learned_and_tested_first(arm: Campaign) -> None:
    next(iter(simulate(arm, 1)))
    path = arm.path / "journal.jsonl"
    lines = path.read_text().splitlines(keepends=True)
    kinds = [event.event for event in arm.events()]
    path.write_text("".join(lines[: kinds.index("trained")]))
    list(simulate(arm, 0))
    assert [event.event for event in arm.events()] == kinds


def test_the_tests_are_fixed_by_the_seed_and_safe(arm: Campaign) -> None:
    one, two = motions_of(arm), motions_of(arm)
    assert list(one) == ["fourier", "moves"]
    t = np.linspace(0.0, 8.0, 50)
    for name, motion in one.items():
        np.testing.assert_array_equal(motion.sample(t).q, two[name].sample(t).q)
        assert certify(motion, arm.spec).ok


def test_a_robot_without_a_plant(campaign: Campaign) -> None:
    with pytest.raises(UsageError, match=r"robot 'pair' has no simulated plant.*arm4"):
        list(simulate(campaign, 1))
