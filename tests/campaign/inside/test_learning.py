"""Learning for real, on a small robot: scores before learning, facts for the stop rule, models on disk."""

from __future__ import annotations

import json
from dataclasses import astuple, replace
from pathlib import Path

import numpy as np
import pytest
from small_robot import command_of, make_campaign, random_motion, write_log

from etude import ask, status, tell
from etude.campaign import Campaign, ingested_samples, label, newest_model, stored_trajectory
from etude.campaign import training as learning
from etude.campaign.evaluate.stopping import calibration_factor, seen_by_the_rule
from etude.campaign.record.stored_models import MIXED
from etude.cli import main
from etude.codes import Warn
from etude.errors import DataError, StopRuleReached
from etude.models import LearnedModel

pytestmark = pytest.mark.as_logged

CONFIG = """\
[trajectory]
duration = 20.0
[data]
cutoff_hz = 5.0
[model]
rung = "gp"
candidates = ["default"]
points = 100
fit_points = 60
steps = 5
[design]
candidates = 4
refine = 1
steps = 3
points = 20
reference_points = 20
"""


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """A foreign log, then two answered proposals."""
    folder = tmp_path_factory.mktemp("learning")
    campaign = make_campaign(folder, config=CONFIG)
    tell(campaign, write_log(folder / "foreign.csv", random_motion(campaign, 8)))
    for _ in range(2):
        number = ask(campaign).number
        tell(campaign, write_log(folder / f"{number}.csv", stored_trajectory(campaign, number), number))
    return campaign


def test_a_log_is_scored_before_it_is_learned(learned: Campaign) -> None:
    first, second, third = learned.state().trained
    assert first.trained is not None
    assert second.trained is not None
    assert third.trained is not None
    assert first.trained.models == {}
    assert all(len(figures) == 2 for figures in astuple(second.trained.models["gp"]))
    assert max(third.trained.models["gp"].nmse) < 0.2
    assert third.trained.logs == (1, 2, 3)
    assert third.trained.robot_seconds == pytest.approx(3 * 20.5, abs=2.0)


def test_the_linear_baseline_has_not_seen_the_log_that_it_is_scored_on(learned: Campaign) -> None:
    for newest in (1, 2):
        samples = ingested_samples(learned, [1, 2, 3][: newest + 1])
        inputs = np.column_stack([*(samples.log[n] for n in ("q", "qd", "qdd")), np.ones(len(samples))])
        known, new = samples.group < newest, samples.group == newest
        nmse = []
        for tau, usable, moving in zip(samples.command.T, samples.usable.T, samples.moving.T, strict=True):
            taught, use = known & usable, new & usable & moving
            weights = np.linalg.lstsq(inputs[taught], tau[taught], rcond=None)[0]
            nmse.append(np.mean((tau[use] - inputs[use] @ weights) ** 2) / np.var(tau[use]))
        scored = learned.state().rounds[newest + 1].trained.models["linear"]  # type: ignore[union-attr]
        np.testing.assert_allclose(scored.nmse, nmse, rtol=1e-6)


def test_later_trajectories_are_designed(learned: Campaign) -> None:
    facts = learned.state().rounds[3].asked
    assert facts is not None
    assert facts.criterion == "log_ivr"
    assert facts.learned == 2
    assert 0.0 < facts.gain < 1.0


def test_evidence_joins_what_was_asked_and_learned(learned: Campaign) -> None:
    state = learned.state()
    evidence = seen_by_the_rule(learned, state)
    assert [e.number for e in evidence] == [1, 2, 3]
    gains = [state.rounds[n].asked.gain for n in (2, 3)]  # type: ignore[union-attr]
    assert [e.gain for e in evidence] == [*gains, None]
    assert seen_by_the_rule(learned, state, 0.25)[-1].gain == 0.25
    assert [e.robot_minutes for e in evidence] == sorted(e.robot_minutes for e in evidence)
    newest = state.newest
    assert newest is not None
    assert newest.new_motion is not None
    assert newest.new_motion.logs == 3
    assert calibration_factor(state.trained) == pytest.approx(np.mean(newest.new_motion.used.z2))


def test_a_foreign_log_is_scored_on_held_out_blocks(learned: Campaign) -> None:
    first = learned.state().rounds[1].trained
    assert first is not None
    assert first.held_out is not None
    assert (first.held_out.blocks, first.held_out.of) == ((3, 8, 13, 18), 20)
    assert max(first.held_out.nmse["gp"]) < max(first.held_out.nmse["linear regression"])
    assert first.new_motion is None


def test_several_logs_are_scored_on_each_other(learned: Campaign) -> None:
    found = status(learned)
    assert found["held_out"] is None
    assert found["new_motion"]["logs"] == 3
    assert max(found["new_motion"]["used"]["nmse"]) < min(found["new_motion"]["linear"])


def test_what_is_in_use_is_scored_on_held_out_blocks_where_outputs_use_different_models(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(LearnedModel, "in_use", property(lambda model: (*model.chosen, "another")))
    campaign = make_campaign(tmp_path, config=CONFIG)
    tell(campaign, write_log(tmp_path / "foreign.csv", random_motion(campaign, 8)))
    found = status(campaign)["held_out"]
    assert found["chosen"] == MIXED
    assert found["nmse"][MIXED] == found["nmse"]["gp"]  # the only one that there is
    assert main(["status", str(campaign.path)]) == 0
    said = capsys.readouterr().out
    assert "nMSE within log 1, blocks 3, 8, 13, 18 of 20 from the others" in said
    assert "ingest a second log" in said


def test_the_stored_model_predicts(learned: Campaign) -> None:
    model = newest_model(learned, learned.state())
    motion = stored_trajectory(learned, 3).motion(np.linspace(2.0, 18.0, 40), 3)
    mean, variance = model.posterior(model.inputs.states(motion))
    command = command_of(*motion.orders)
    assert np.mean((mean - command) ** 2) < 0.1 * np.var(command)
    assert (variance > 0).all()


def test_the_same_facts_ask_and_learn_the_same(learned: Campaign, tmp_path: Path) -> None:
    """Two copies of a campaign design the same trajectory, to the last bit."""
    import shutil

    from etude.campaign import open_campaign

    texts = []
    for name in ("a", "b"):
        shutil.copytree(learned.path, tmp_path / name)
        proposal = ask(open_campaign(tmp_path / name))
        texts.append((proposal.folder / "trajectory.json").read_text())
    assert texts[0] == texts[1]
    assert json.loads(texts[0])["form"] == "fourier"


def test_the_gain_of_the_designed_trajectory_can_stop(
    learned: Campaign, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import shutil

    from etude.campaign import open_campaign

    shutil.copytree(learned.path, tmp_path / "lab")
    path = tmp_path / "lab" / "campaign.toml"
    path.write_text(
        path.read_text() + "[stop]\ngain_per_minute = 1e6\ncommand_tolerance = 0\nnoise_fraction = 0\n"
    )
    campaign = open_campaign(tmp_path / "lab")
    monkeypatch.setattr("etude.campaign.evaluate.stopping.LEAST_SEGMENTS", 3)  # a log has one here
    with pytest.raises(StopRuleReached, match=r"\(gain\)"):
        ask(campaign)
    assert not campaign.proposal(4).exists()
    assert ask(campaign, go_on=True).number == 4


@pytest.mark.parametrize(
    "structure", [*(pytest.param(own, marks=pytest.mark.slow) for own in ("linear", "linear+gp")), "auto"]
)
def test_every_rung_can_be_learned_forecast_and_designed_with(structure: str, tmp_path: Path) -> None:
    members = 'rung = "gp"\ncandidates = ["default"]'  # here with all that are trained by default
    campaign = make_campaign(tmp_path, config=CONFIG.replace(members, f'rung = "{structure}"'))
    for seed in (1, 2):
        tell(campaign, write_log(tmp_path / f"{seed}.csv", random_motion(campaign, seed)), foreign=True)
    facts = campaign.state().trained[-1].trained
    assert facts is not None
    assert structure in (facts.chosen, "auto")
    assert len(facts.rungs) == 2
    assert ask(campaign, go_on=True).certificate.ok


def test_a_log_whose_blocks_cannot_be_learned_alone_is_learned_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Blocks of a single log are held out and learned from its others alone, which physics may refuse."""
    campaign = make_campaign(tmp_path, config=CONFIG)

    def refused(*_: object) -> None:
        raise DataError("An axis never moves, so nothing of it can be identified", where="hip")

    monkeypatch.setattr(learning, "_held_out", refused)
    tell(campaign, write_log(tmp_path / "1.csv", random_motion(campaign, 1)), foreign=True)
    assert [r.number for r in campaign.state().learned] == [1]
    facts = campaign.state().trained[-1].trained
    assert facts is not None
    assert facts.held_out is None
    (said,) = [one for one in facts.warnings if one.code == Warn.NO_BLOCKS]
    assert said.fields["log"] == 1
    assert "hip" in said.sentence
    assert status(campaign)["held_out"] is None


def test_commands_of_different_rungs_are_scored_as_they_are_used(learned: Campaign) -> None:
    samples = ingested_samples(learned, [1, 2, 3])
    model = newest_model(learned, learned.state())
    alone = [c for c in model.candidates if len(c.commands) == 1 and c.name == "default"]
    model = replace(model, candidates=tuple(replace(c, weights=np.ones(1), share=np.ones(1)) for c in alone))
    (candidate,) = [c for c in model.candidates if c.commands == (1,)]
    other = replace(candidate, structure="another")
    mixed = replace(model, candidates=tuple(other if c is candidate else c for c in model.candidates))
    assert mixed.chosen == ("gp", "another")
    assert (label(mixed.chosen), label(model.chosen)) == (MIXED, "gp")
    scores = [learning._scores(m, model.inputs, samples, 2) for m in (model, mixed)]
    assert scores[1][MIXED] == scores[0]["gp"]
    assert MIXED not in scores[0]
    assert "gp" not in scores[1]
