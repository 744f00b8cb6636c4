"""Promote, roll back, confirm, watch: what leaves for the robot, and what its logs say of it afterwards."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from small_robot import command_of, make_campaign, random_motion, write_log
from test_changed_robot import CHANGES, write_changed
from test_learning import CONFIG

from etude import predict, promote, rollback, status, tell, watch
from etude.campaign import (
    Campaign,
    ask_to_confirm,
    newest_model,
    open_campaign,
    read_events,
    stored_trajectory,
    write_table,
)
from etude.campaign.deployment.predict import check_table
from etude.campaign.deployment.promote import is_undecided
from etude.campaign.record.confirmation import SPREAD
from etude.campaign.record.deployed_model import deployed_model, pinned
from etude.campaign.record.events import Promoted
from etude.cli import main
from etude.codes import Refusal
from etude.errors import DataError, UsageError
from etude.progress import watched
from etude.report import build_report, number
from etude.trajectories import PointToPoint
from etude.types import Motion

pytestmark = pytest.mark.as_logged


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """Five logs of the pair, learned together."""
    folder = tmp_path_factory.mktemp("watched")
    campaign = make_campaign(folder, config=CONFIG)
    logs = [write_log(folder / f"{n}.csv", random_motion(campaign, n), n) for n in range(1, 6)]
    tell(campaign, logs, foreign=True)
    return campaign


@pytest.fixture
def fresh(known: Campaign, tmp_path: Path) -> Campaign:
    shutil.copytree(known.path, tmp_path / "lab")
    return open_campaign(tmp_path / "lab")


def test_the_commands_say_which_model_they_mean_and_what_comes_next(
    fresh: Campaign, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = str(fresh.path)
    assert main(["rollback", folder]) == 2
    assert f"Promote one: etude promote {folder}." in capsys.readouterr().err
    assert main(["promote", folder]) == 0
    assert f"Next: etude export {folder} --to c, and etude watch {folder} LOG." in capsys.readouterr().out


def test_predict_takes_no_motion_of_another_robot_and_no_other_file(fresh: Campaign, tmp_path: Path) -> None:
    motion = random_motion(fresh, 1)
    one = tmp_path / "trajectory.json"
    one.write_text(motion.to_json(), encoding="utf-8")
    said: list[str] = []
    assert len(predict(fresh, one, say=said.append)) > 10
    assert said[0].startswith("No model was promoted yet. The newest model is used, of log 5")
    one.write_text(PointToPoint(np.array([[0.0] * 3, [0.1] * 3]), 1.0).to_json(), encoding="utf-8")
    with pytest.raises(DataError, match=r"the motion has 3 axes, and pair has 2 \[.*trajectory.json\]"):
        predict(fresh, one)
    one.write_text('{"proved": true}', encoding="utf-8")
    with pytest.raises(UsageError, match=r"trajectory.json\]. Name a trajectory.json of etude ask"):
        predict(fresh, one)
    with pytest.raises(UsageError, match=r"Name it x.csv"):
        check_table(tmp_path / "x.txt")


def test_rows_outside_what_was_learned_are_marked_and_counted(fresh: Campaign, tmp_path: Path) -> None:
    """By the deviation of each command, which a state far from all data has and one among them has not."""
    model = newest_model(fresh, fresh.state())
    plain = [i for i, column in enumerate(model.inputs.columns) if not column[3]]
    states = np.tile(model.ranges[:, plain].mean(axis=0), (5, 1))
    states[3, 1] += 40.0  # the knee's position, rad
    states[4, 2] -= 400.0  # the hip's velocity
    log = model.inputs.states(Motion(np.arange(5) / 50.0, states.reshape(5, 3, 2).transpose(1, 0, 2)))
    done: list[float] = []
    with watched(done.append):
        found = predict(fresh, log)
    assert 0.0 in done
    assert done[-1] == pytest.approx(1.0)
    spread = found["deviation"]
    assert (spread[3:, 1] > 2.0 * spread[:3, 1].max()).all()
    np.testing.assert_array_equal(found["outside"][:, 1], [0.0, 0.0, 0.0, 1.0, 1.0])
    np.testing.assert_array_equal(found["outside"], model.outside(log))
    illegal, said = found.repairs
    assert illegal.startswith("These states are beyond the robot's limits: knee q ")
    assert ", hip qd " in illegal
    assert not any("qdd" in one or "hip q " in one for one in illegal.split(", ")), (
        "what is legal is not named"
    )
    assert said.startswith("Rows outside the training data: hip 40 %, knee 40 %. Their deviation")
    assert predict(fresh, log.take(slice(0, 3))).repairs == ()
    write_table(tmp_path / "c.csv", found)
    lines = (tmp_path / "c.csv").read_text().splitlines()
    assert [line.split(",")[-1] for line in lines] == ["outside_knee", "0.0", "0.0", "0.0", "1.0", "1.0"]


def one_more(campaign: Campaign, folder: Path, seed: int) -> None:
    tell(campaign, write_log(folder / f"{seed}.csv", random_motion(campaign, seed), seed), foreign=True)


def test_the_newest_model_stands_in_until_one_is_promoted(fresh: Campaign) -> None:
    used = deployed_model(fresh)
    assert not used.promoted
    assert used.number == 5
    assert "No model was promoted yet. The newest model" in used.sentence


def test_a_model_that_beats_physics_is_promoted_and_stays_while_others_are_learned(
    fresh: Campaign, tmp_path: Path
) -> None:
    found = promote(fresh)
    assert found.promoted
    assert not found.forced
    assert found.refused == ()
    (physics,) = found.compared
    assert (physics.against, physics.segments, physics.decision) == ("linear regression", 5, "better")
    assert physics.upper < 1.0
    event = read_events(fresh.path)[-1]
    assert (event.event, event.number, event.fact.forced) == ("promoted", 5, False)
    assert event.files == {f"promoted/{found.sha256[:12]}.npz": found.sha256}
    assert promote(fresh).repeated
    one_more(fresh, tmp_path, 6)
    used = deployed_model(fresh)
    assert used.promoted
    assert (used.number, used.sha256) == (5, found.sha256)
    assert status(fresh)["in_use"] == {
        "number": 5,
        "sha256": found.sha256,
        "forced": False,
        "newest": 6,
    }


def test_level_with_physics_is_enough_and_level_with_the_model_in_use_is_not(
    fresh: Campaign, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "etude.campaign.deployment.promote.compared"
    made = import_module(name.rpartition(".")[0]).compared
    figures = {"segments": 5, "ratio": 0.98, "lower": 0.7, "upper": 1.4}
    monkeypatch.setattr(name, lambda *errors: replace(made(*errors), **figures))
    assert [one.code for one in promote(fresh).refused] == [Refusal.NOT_YET_BETTER]
    assert is_undecided(fresh)
    figures |= {"lower": 0.9, "upper": 1.06}
    assert not is_undecided(fresh)
    assert promote(fresh).promoted
    one_more(fresh, tmp_path, 6)
    found = promote(fresh)
    assert [one.decision for one in found.compared] == ["level", "level"]
    assert not is_undecided(fresh)
    (said,) = found.refused
    assert said.code == Refusal.NOT_BETTER
    assert "the model in use" in said.sentence


def test_only_segments_that_the_model_in_use_has_not_learned_are_compared(
    fresh: Campaign, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    promote(fresh)
    assert not is_undecided(fresh), "it is in use"
    one_more(fresh, tmp_path, 6)
    assert is_undecided(fresh)
    found = promote(fresh)
    physics, used = found.compared
    assert not found.promoted
    assert (physics.segments, used.segments) == (6, 1)
    assert used.decision == "not decided"
    (said,) = found.refused
    assert said.code == Refusal.NOT_DECIDED
    assert said.sentence == (
        "no decision against the model in use, of log 5: 1 segment that neither model was trained on, but "
        "4 are needed"
    )
    assert main(["promote", str(fresh.path)]) == 3
    assert (
        f"Next: etude ask {fresh.path} --continue, then run it and ingest its log." in capsys.readouterr().out
    )
    # of the same log: the ratio is that of two predictions that have not seen it, computed here anew
    from etude.campaign import ingested_samples
    from etude.campaign.record.stored_models import LEFT_OUT
    from etude.models import in_order, read_residuals

    left_out = read_residuals(fresh.model_folder(6) / LEFT_OUT)
    own = left_out.group == left_out.group.max()
    samples = in_order(ingested_samples(fresh, [1, 2, 3, 4, 5, 6])).take(left_out.rows[own])
    error = samples.target - deployed_model(fresh).model.posterior(samples.log)[0]
    knee = np.isfinite(left_out.error[own][:, 1])
    rms = [np.sqrt(np.mean(e[knee, 1] ** 2)) for e in (left_out.error[own], error)]
    assert used.by_command[1] == pytest.approx(rms[0] / rms[1])


def test_force_says_why_and_is_recorded(fresh: Campaign, tmp_path: Path) -> None:
    promote(fresh)
    one_more(fresh, tmp_path, 6)
    with pytest.raises(UsageError, match="needs a reason"):
        promote(fresh, force=True)
    found = promote(fresh, force=True, reason="a demonstration")
    assert found.promoted
    assert found.forced
    assert found.refused
    fact = read_events(fresh.path)[-1].fact
    assert isinstance(fact, Promoted)
    assert (fact.forced, fact.reason, fact.refused) == (True, "a demonstration", found.refused)
    assert rollback(fresh, reason="over") == (6, 5)
    assert deployed_model(fresh).number == 5
    assert read_events(fresh.path)[-1].event == "rolled_back"
    assert (fresh.path / "promoted" / f"{found.sha256[:12]}.npz").exists()
    with pytest.raises(UsageError, match="no model was in use before"):
        rollback(fresh)


def test_an_altered_file_is_refused_by_all_that_use_it(fresh: Campaign, tmp_path: Path) -> None:
    path = pinned(fresh, promote(fresh).sha256)
    path.write_bytes(path.read_bytes() + b"\0")
    log = write_log(tmp_path / "7.csv", random_motion(fresh, 7), 7)
    for use in (
        lambda: deployed_model(fresh),
        lambda: watch(fresh, [log]),
        lambda: ask_to_confirm(fresh),
        lambda: promote(fresh),
    ):
        with pytest.raises(UsageError, match="was changed after it was promoted"):
            use()
    (problem,) = status(fresh)["problems"]
    assert problem["sentence"] == f"promoted/{path.name} was changed after Étude stored it"
    path.unlink()
    with pytest.raises(UsageError, match="is missing") as refused:
        deployed_model(fresh)
    assert "etude promote" in refused.value.next_step
    promote(fresh, force=True, reason="altered file")
    assert deployed_model(fresh).number == 5


def test_nothing_learned_nothing_promoted(tmp_path: Path) -> None:
    campaign = make_campaign(tmp_path)
    with pytest.raises(UsageError, match="nothing has been learned"):
        promote(campaign)
    with pytest.raises(UsageError, match="nothing was promoted"):
        rollback(campaign)


def shifted(path: Path, shift: float) -> Path:
    """The same log with the hip read so much higher, rad."""
    lines = path.read_text().splitlines()
    rows = [line.split(",") for line in lines[1:]]
    text = [",".join([row[0], repr(float(row[1]) + shift), *row[2:]]) for row in rows]
    path.write_text("\n".join([lines[0], *text]) + "\n")
    return path


def test_runs_that_confirm_are_measured_and_never_learned(fresh: Campaign, tmp_path: Path) -> None:
    made = ask_to_confirm(fresh)
    assert made.new
    assert made.certificate.ok
    motion = stored_trajectory(fresh, made.number)
    header, first = (made.folder / "feedforward.csv").read_text().splitlines()[:2]
    assert header.endswith("command_hip,command_knee")
    states = newest_model(fresh, fresh.state()).inputs.states(motion.motion(np.zeros(1), 3))
    wanted = newest_model(fresh, fresh.state()).mean(states)[0]
    np.testing.assert_allclose([float(v) for v in first.split(",")[-2:]], wanted, rtol=1e-9)

    before = (fresh.model_folder(5) / "model.npz").read_bytes()
    without = shifted(write_log(tmp_path / "without.csv", motion, 1), 0.02)
    with pytest.raises(DataError, match="never used for training"):
        tell(fresh, without)
    with pytest.raises(DataError, match="never used for training"):
        tell(fresh, without, foreign=True, number=90)
    with pytest.raises(UsageError, match="no such run"):
        tell(fresh, without, confirm="perhaps")
    told = tell(fresh, without, confirm="without")
    assert (told.number, told.run, told.learned) == (made.number, "without", ())
    assert tell(fresh, without, confirm="without").repeated
    assert ask_to_confirm(fresh).number == made.number
    tell(fresh, write_log(tmp_path / "with.csv", motion, 2), confirm="with")
    (found,) = status(fresh)["confirmed"]
    assert found["without"][0] == pytest.approx(np.rad2deg(0.02), rel=0.02)
    assert max(found["with"]) < 0.02
    assert found["units"] == ["deg", "deg"]
    ratio, first = np.array(found["left_over"]), fresh.round(made.number).runs["without"]
    part = ratio * np.array(first.moving)
    most = np.hypot(SPREAD * part, np.hypot(first.late, first.noise))
    wide = np.stack([np.hypot(part / SPREAD, first.noise), most], axis=1)
    np.testing.assert_allclose(found["forecast"], wide)
    assert np.all((ratio > 0.0) & (ratio < 1.0))
    assert first.moving[0] == pytest.approx(np.rad2deg(0.02), rel=0.02)
    assert found["moving"][0] == pytest.approx(found["with"][0], rel=0.5)
    page = build_report(fresh.path).read_text(encoding="utf-8")
    page = page[page.index(f"Trajectory {made.number}.") :][:3000]
    assert number(found["without"][0]) in page
    assert " .. ".join(number(v, 2) for v in found["forecast"][1]) in page
    assert (fresh.model_folder(5) / "model.npz").read_bytes() == before
    assert fresh.state().pending == []
    assert [r.number for r in fresh.state().learned] == [1, 2, 3, 4, 5]
    assert fresh.state().proposals == []
    with pytest.raises(DataError, match="not the log of the proposed"):
        tell(fresh, write_log(tmp_path / "o.csv", random_motion(fresh, 9), 9), confirm="with")


@pytest.mark.slow
@pytest.mark.parametrize(("words", "kind"), [("a load was", "payload"), ("friction has", "friction")])
def test_watch_names_a_change_and_proposes_a_motion(
    fresh: Campaign, tmp_path: Path, words: str, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    change = next(own for name, own in CHANGES.items() if name.startswith(words))
    same = write_log(tmp_path / "same.csv", random_motion(fresh, 8), 8)
    other = write_changed(tmp_path / "other.csv", fresh, 9, change)
    told = [r.number for r in fresh.state().ingested]
    assert main(["watch", str(fresh.path), str(same), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["changed"] is False
    assert main(["watch", str(fresh.path), str(same), str(other), "--json"]) == 6
    data = json.loads(capsys.readouterr().out)
    assert [one["verdict"] for one in data["logs"]] == ["unchanged", "changed"]
    assert data["kind"] == kind
    assert data["logs"][1]["kind"] == kind
    assert data["proposal"]["duration"] == fresh.config.duration
    state = open_campaign(fresh.path).state()
    assert [r.number for r in state.ingested] == told
    assert [r.number for r in state.proposals] == [data["proposal"]["number"]]
    # asked again, the open one is shown
    assert watch(open_campaign(fresh.path), [other]).proposal.number == data["proposal"]["number"]  # type: ignore[union-attr]


def test_watch_says_sensor_unknown_and_refused(fresh: Campaign, tmp_path: Path) -> None:
    motion = random_motion(fresh, 8)
    path = write_log(tmp_path / "stuck.csv", motion, 8)
    lines = path.read_text().splitlines()
    rows = [line.split(",") for line in lines[1:]]
    for row in rows[200:]:
        row[4] = rows[200][4]
    path.write_text("\n".join([lines[0], *(",".join(row) for row in rows)]) + "\n")
    odd = write_changed(
        tmp_path / "odd.csv",
        fresh,
        9,
        lambda q, qd, qdd: command_of(q, qd, qdd) + 2.0 * np.sin(9.0 * q) * np.cos(7.0 * qd),
    )
    empty = tmp_path / "empty.csv"
    empty.write_text("time,q_hip\n0,1\n")
    found = watch(fresh, [path, odd, empty], propose=False)
    assert [(one.verdict, one.kind) for one in found.logs] == [
        ("changed", "sensor"),
        ("changed", "unknown"),
        ("refused", ""),
    ]
    assert found.logs[0].command == "knee"
    assert found.proposal is None
    with pytest.raises(UsageError, match="no log to watch"):
        watch(fresh, [])
