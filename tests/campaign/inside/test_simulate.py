"""The simulated loop, with a model that costs nothing: what is run, tested, committed and not repeated."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from etude import plugins, tell
from etude.campaign import (
    Asked,
    Campaign,
    Trained,
    TrainingOutcome,
    create_campaign,
    open_campaign,
    simulate,
    typical_motions,
)
from etude.campaign import simulation as module
from etude.campaign import test_motions as motions_of
from etude.campaign import training as learning
from etude.campaign.ingest import tell as telling
from etude.campaign.propose import ask as asking
from etude.campaign.record.state import CHANGED
from etude.cli import main
from etude.errors import UsageError
from etude.limits import certify
from etude.protocols import Controller, Model
from etude.types import Finding

pytestmark = pytest.mark.as_logged

CONFIG = 'kind = "arm"\nseed = 4\n[trajectory]\nduration = 8.0\n'
JOURNAL = "journal.jsonl"


@pytest.fixture
def arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Campaign:
    """Learning and designing cost nothing, and the model says nothing."""

    def learn(campaign: Campaign, state: Any, number: int) -> TrainingOutcome:
        return TrainingOutcome([], Trained(chosen="gp", rungs=("gp",) * 4, robot_seconds=8.0 * number))

    def again(campaign: Campaign, _: Any, rng: np.random.Generator, *rest: Any) -> Any:
        *_, limits, _ = rest
        return typical_motions(campaign, rng, 1, limits)[0], Asked(status="")

    def silent(_: Any, spec: Any, config: Any, model: Model) -> Controller | None:
        return None

    monkeypatch.setattr(learning, "learn_log", learn)
    monkeypatch.setattr(asking, "proposed", again)
    monkeypatch.setattr(asking, "newest_model", lambda *_: None)
    monkeypatch.setattr(module, "newest_model", lambda *_: None)
    monkeypatch.setattr(module, "only_structure", lambda *_: None)
    monkeypatch.setattr("etude_arm.motions.MOVES", 1)
    path = create_campaign(tmp_path / "lab", "arm4", seed=4)[0].path
    (path / "campaign.toml").write_text(CONFIG)
    campaign = open_campaign(path)
    monkeypatch.setattr(type(campaign.kind), "controller", silent)
    return campaign


def test_rounds_tests_and_baselines(arm: Campaign) -> None:
    done = list(simulate(arm, 2))
    assert [r.number for r in done] == [1, 2]
    assert [round(r.robot_seconds) for r in done] == [8, 16]
    evaluated = arm.state().evaluated
    keys = [(number, e.baseline, e.test) for number, e in evaluated]
    assert len(set(keys)) == len(keys) == 8
    by = {key: np.mean(e.errors) for key, (_, e) in zip(keys, evaluated, strict=True)}
    assert by[0, "perfect", "fourier"] < 0.3 * by[0, "pd", "fourier"]
    # a model that says nothing is PD alone
    assert by[1, "", "fourier"] == pytest.approx(by[0, "pd", "fourier"])
    kept = sorted(path.name for path in (arm.path / "tests").iterdir())
    who = ("0000.pd", "0001.learned", "0002.learned")
    assert kept == [f"{name}.{test}.parquet" for name in who for test in ("fourier", "moves")]


def test_going_on_repeats_nothing(arm: Campaign) -> None:
    list(simulate(arm, 1))
    before = arm.events()
    assert list(simulate(arm, 0)) == []
    assert arm.events() == before
    assert [r.number for r in simulate(arm, 1)] == [2]
    assert arm.events()[: len(before)] == before


def test_an_interrupted_test_is_made_up_for(arm: Campaign) -> None:
    next(iter(simulate(arm, 1)))
    lines = (arm.path / JOURNAL).read_text().splitlines(keepends=True)
    assert '"evaluated"' in lines[-1]
    (arm.path / JOURNAL).write_text("".join(lines[:-1]))
    list(simulate(arm, 0))
    assert len(arm.events()) == len(lines)


def test_a_log_left_unlearned_is_learned_and_tested_first(arm: Campaign) -> None:
    next(iter(simulate(arm, 1)))
    path = arm.path / JOURNAL
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
        np.testing.assert_array_equal(motion.motion(t, 1).orders, two[name].motion(t, 1).orders)
        assert certify(motion, arm.limits()).ok


def test_the_other_engine_agrees(arm: Campaign, tmp_path: Path) -> None:
    list(simulate(arm, 0, "mujoco"))
    other = create_campaign(tmp_path / "other", "arm4", seed=4)[0]
    (other.path / "campaign.toml").write_text(CONFIG)
    list(simulate(open_campaign(other.path), 0, "compiled"))
    pairs = zip(arm.state().evaluated, other.state().evaluated, strict=True)
    for (_, a), (_, b) in pairs:
        np.testing.assert_allclose(a.errors, b.errors, atol=0.002)


@pytest.fixture
def noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is told is of another robot."""
    found = Finding(CHANGED, "red", "the robot is another one", "Say --changed new.", "--changed")
    monkeypatch.setattr(telling, "change_of_robot", lambda *_: found)


@pytest.mark.usefixtures("noticed")
def test_a_changed_robot_that_is_noticed_waits_and_nothing_is_run_after_it(arm: Campaign) -> None:
    said: list[str] = []
    assert list(simulate(arm, 2, say=said.append, change={"payload": 0.5})) == []
    assert [r.number for r in arm.state().awaiting_answer] == [1]
    assert "Log 1 is not used for training yet: the robot is another one. Say --changed new." in said
    with pytest.raises(UsageError, match="log 1 waits for an answer"):
        next(iter(simulate(arm, 1)))
    tell(arm, [], changed="same")
    assert [r.number for r in simulate(arm, 1)] == [2]


def test_the_changed_robot_is_run_and_one_that_is_not_noticed_is_learned(
    arm: Campaign, tmp_path: Path
) -> None:
    other = create_campaign(tmp_path / "other", "arm4", seed=4)[0]
    (other.path / "campaign.toml").write_text(CONFIG)
    assert [r.number for r in simulate(arm, 1)] == [1]
    assert [r.number for r in simulate(open_campaign(other.path), 1, change={"friction": 1.5})] == [1]
    one, two = (pl.read_parquet(lab.path / "simulated" / "0001.parquet") for lab in (arm, other))
    assert one["q_des_elbow"].equals(two["q_des_elbow"])
    assert (one["command_elbow"] - two["command_elbow"]).abs().max() > 5.0


@pytest.mark.usefixtures("noticed")
def test_the_command_ends_in_what_may_be_done_next(arm: Campaign, capsys: pytest.CaptureFixture[str]) -> None:
    folder = str(arm.path)
    assert main(["simulate", folder, "--rounds", "1", "--change", "payload=0.5"]) == 6
    assert f"Next: etude tell {folder} --changed new (or forget, or same)." in capsys.readouterr().out
    tell(arm, [], changed="same")
    assert main(["simulate", folder, "--rounds", "0"]) == 0
    assert f"Next: etude status {folder}, etude report {folder}, etude promote" in capsys.readouterr().out


def test_changes_that_are_none(arm: Campaign, capsys: pytest.CaptureFixture[str]) -> None:
    for word, said in (
        ("payload", "is not a change"),
        ("friction=much", "is not a change"),
        ("wind=3", "no 'wind'"),
    ):
        assert main(["simulate", str(arm.path), "--rounds", "0", "--change", word]) == 2
        assert said in capsys.readouterr().err


def test_a_robot_without_a_plant(campaign: Campaign) -> None:
    with pytest.raises(UsageError, match=r"robot 'pair' has no simulated plant"):
        list(simulate(campaign, 1))


def test_online_each_test_is_run_once_more_by_a_learner_of_its_own(arm, monkeypatch) -> None:
    """Facts of a baseline called "online", made from the round's model, and not made again."""
    made = []

    class Learner:
        def planned(self, motion: Any) -> None:
            return None

        def command(self, t: float, row: Any) -> tuple[np.ndarray, np.ndarray]:
            return np.full(4, 5.0), np.zeros(4)

        def observe(self, t: float, row: Any) -> None:
            assert {"q", "q_des", "command"} <= set(row)

    class Learning:
        def require(self, campaign: Campaign, robot: Any) -> None:
            assert robot.asks_each_tick

        def controllers(self, campaign: Campaign, robot: Any) -> Any:
            return lambda: made.append(campaign) or Learner()

    list(simulate(arm, 1, online=Learning()))
    events = [e for _, e in arm.state().evaluated if e.baseline == "online"]
    assert [e.test for e in events] == list(motions_of(arm))
    assert made == [arm] * len(events)
    list(simulate(arm, 0, online=Learning()))
    assert len(made) == len(events)


def test_a_robot_that_takes_its_feedforward_ahead_learns_nothing_on_the_way(arm) -> None:
    going_on = plugins.load("etude.adaptations", "online")("variance")
    for ask_for in (going_on.require, going_on.controllers):
        with pytest.raises(UsageError, match="before a run"):
            ask_for(arm, object())
    assert main(["simulate", str(arm.path), "--online", "--method", "magic", "--rounds", "1"]) == 2


@pytest.mark.parametrize("feedforward", [pytest.param(False, marks=pytest.mark.slow), True])
def test_motions_that_teach_are_run_with_what_was_learned_if_wanted(
    arm: Campaign, monkeypatch: pytest.MonkeyPatch, feedforward: bool
) -> None:
    def exact(self: Any, spec: Any, config: Any, model: Model) -> Controller | None:
        return self.baselines(spec, config)["perfect"]  # type: ignore[no-any-return]

    monkeypatch.setattr(type(arm.kind), "controller", exact)
    list(simulate(arm, 2, feedforward=feedforward))
    first, second = (r.ingested.tracked["fourier"][0] for r in arm.state().ingested if r.ingested)
    ratio = np.max(second) / np.max(first)
    assert ratio < 0.5 if feedforward else ratio > 0.5
