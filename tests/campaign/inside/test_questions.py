"""tell asks before it learns: nothing false is stored, an answer is one flag, and it is asked once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from small_robot import random_motion, stub_learner, write_log

import etude
from etude import tell, untell
from etude.campaign import Campaign, IngestResult, judged_commands
from etude.campaign.ingest.ingest_result import read as read_told
from etude.campaign.ingest.questions import body_of, unit_findings
from etude.cli import main
from etude.errors import DataError, UsageError
from etude.logs import read_log_file
from etude.types import Log
from etude_arm import KIND as ARM


def told(campaign: Campaign, path: Path, **answers: tuple[str, ...]) -> IngestResult:
    return tell(campaign, path, foreign=True, learner=stub_learner, **answers)  # type: ignore[arg-type]


def changed(campaign: Campaign, path: Path, seed: int, **factors: float) -> Path:
    """A log of the pair, columns times factors."""
    lines = write_log(path, random_motion(campaign, seed), seed).read_text().splitlines()
    names = lines[0].split(",")
    rows = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    for name, factor in factors.items():
        rows[:, names.index(name)] *= factor
    text = [lines[0], *(",".join(map(repr, row)) for row in rows.tolist())]
    path.write_text("\n".join(text) + "\n")
    return path


def test_a_wrong_sign_is_a_question_and_nothing_is_stored(campaign: Campaign, tmp_path: Path) -> None:
    path = changed(campaign, tmp_path / "log.csv", 1, tau_hip=-1.0)
    with pytest.raises(DataError, match="sign of the commands of hip is inverted") as refused:
        told(campaign, path)
    assert "--repair sign" in refused.value.next_step
    assert "--accept sign" in refused.value.next_step
    assert not campaign.state().ingested


def test_what_several_files_share_is_said_once(campaign: Campaign, tmp_path: Path, capsys) -> None:
    paths = [changed(campaign, tmp_path / f"log{seed}.csv", seed, tau_hip=-1.0) for seed in (1, 2)]
    assert main(["tell", str(campaign.path), *map(str, paths)]) == 3
    out = capsys.readouterr().out.splitlines()
    assert out[:2] == ["log1.csv  refused", "log2.csv  refused"]
    assert out[2].startswith("log1.csv, log2.csv: The sign of the commands of hip is inverted in all 2 logs")
    assert out[2].count("--repair sign") == 1
    assert len(out) == 3  # nothing was stored: no next step that needs a log


def test_a_repair_turns_the_sign_and_says_so(campaign: Campaign, tmp_path: Path) -> None:
    wrong = changed(campaign, tmp_path / "wrong.csv", 1, tau_hip=-1.0)
    right = write_log(tmp_path / "right.csv", random_motion(campaign, 1), 1)
    found = told(campaign, wrong, repair=("sign",))
    assert "The sign of the commands of hip was inverted, as asked." in found.repairs
    other = told(campaign, right)
    logs = [read_log_file(campaign.run_file(one.number)) for one in (found, other)]
    np.testing.assert_allclose(logs[0]["command"], logs[1]["command"], atol=1e-12)


def test_an_answer_holds_for_later_logs_of_which_the_same_is_found(
    campaign: Campaign, tmp_path: Path
) -> None:
    first = changed(campaign, tmp_path / "first.csv", 1, tau_hip=-1.0)
    assert any("Used without a repair" in s for s in told(campaign, first, accept=("sign",)).repairs)
    again = changed(campaign, tmp_path / "again.csv", 2, tau_hip=-1.0)
    assert any("Used without a repair" in s for s in told(campaign, again).repairs)
    with pytest.raises(DataError, match="commands of knee"):
        told(campaign, changed(campaign, tmp_path / "other.csv", 3, tau_knee=-1.0))


def test_an_answer_about_some_logs_says_nothing_of_one_that_denies_it(
    campaign: Campaign, tmp_path: Path
) -> None:
    wrong = [changed(campaign, tmp_path / f"{seed}.csv", seed, tau_hip=-1.0) for seed in (1, 2)]
    for path, accept in zip(wrong, (("sign",), ()), strict=True):
        told(campaign, path, accept=accept)
    right = write_log(tmp_path / "3.csv", random_motion(campaign, 3), 3)
    with pytest.raises(DataError, match="hip is inverted only in log 1, log 2") as refused:
        told(campaign, right)
    assert "Neither sign" not in refused.value.fact
    assert "Remove them (etude untell" in refused.value.next_step
    assert any("Used without a repair" in s for s in told(campaign, right, accept=("sign",)).repairs)


def test_a_repair_is_of_all_logs_or_of_none(campaign: Campaign, tmp_path: Path) -> None:
    """The first was taken as it is: the advice that refuses the second leads to both, put right."""
    paths = [changed(campaign, tmp_path / f"{seed}.csv", seed, tau_hip=-1.0) for seed in (1, 2, 3)]
    first = told(campaign, paths[0], accept=("sign",))
    with pytest.raises(DataError, match="hip is inverted in all 2 logs") as refused:
        told(campaign, paths[1], repair=("sign",))
    assert "These logs are already learned: log 1. Remove them (etude untell" in refused.value.next_step
    assert untell(campaign, first.number, learner=stub_learner)
    found = tell(campaign, paths[:2], foreign=True, learner=stub_learner, repair=("sign",))
    repairs = [file.ingested.repairs for file in found.files if file.ingested is not None]
    assert [any("was inverted, as asked" in s for s in own) for own in repairs] == [True, True]
    # the newest answer holds for later logs
    assert any("was inverted, as asked" in s for s in told(campaign, paths[2]).repairs)


def test_logs_told_together_are_judged_together(campaign: Campaign, tmp_path: Path) -> None:
    """One log against the others is named, and the others are not asked."""
    right = [write_log(tmp_path / f"{seed}.csv", random_motion(campaign, seed), seed) for seed in (1, 2)]
    wrong = changed(campaign, tmp_path / "wrong.csv", 3, tau_hip=-1.0, tau_knee=-1.0)
    found = tell(campaign, [*right, wrong], foreign=True, learner=stub_learner)
    (refused,) = found.refused
    assert refused.path == wrong
    assert refused.refused is not None
    assert "hip and knee is inverted only in wrong.csv" in refused.refused.fact
    assert "--repair sign" in refused.refused.next_step


def rewritten(path: Path, change: Callable[[np.ndarray], np.ndarray]) -> Path:
    """The log with its cells (T, 5) changed: t, q (2), tau (2)."""
    lines = path.read_text().splitlines()
    rows = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    text = [lines[0], *(",".join(map(repr, row)) for row in change(rows).tolist())]
    path.write_text("\n".join(text) + "\n")
    return path


def test_held_rows_are_dropped_unasked_unless_they_are_accepted(campaign: Campaign, tmp_path: Path) -> None:
    def held(rows: np.ndarray) -> np.ndarray:
        return np.column_stack([rows[:, 0], rows[(np.arange(len(rows)) // 2) * 2, 1:]])

    first, second, third = (
        rewritten(write_log(tmp_path / f"{k}.csv", random_motion(campaign, k), k), held) for k in (1, 2, 3)
    )
    found = told(campaign, first)
    assert any("Every row is repeated 2 times" in s for s in found.repairs)
    assert campaign.state().rounds[found.number].ingested.answers == ()  # type: ignore[union-attr]
    kept = told(campaign, second, accept=("held",))
    assert any(s.endswith("Used without a repair, as asked.") for s in kept.repairs)
    again = told(campaign, third)  # the newest answer counts
    sizes = [len(read_log_file(campaign.run_file(one.number))) for one in (found, kept, again)]
    assert sizes[0] < 0.6 * sizes[1]
    assert sizes[2] > 0.9 * sizes[1]


def test_angles_from_0_to_a_turn_are_refused_and_repaired_when_asked(
    campaign: Campaign, tmp_path: Path
) -> None:
    def wrapping(rows: np.ndarray) -> np.ndarray:
        return np.column_stack([rows[:, 0], rows[:, 1:3] % (2.0 * np.pi), rows[:, 3:]])

    motion = random_motion(campaign, 7)
    right = write_log(tmp_path / "right.csv", motion, 1)
    wrong = rewritten(write_log(tmp_path / "wrong.csv", motion, 1), wrapping)
    with pytest.raises(DataError, match="jumps of one turn") as refused:
        told(campaign, wrong)
    assert "--repair turns" in refused.value.next_step
    found = told(campaign, wrong, repair=("turns",))
    assert any(s.endswith("were unwrapped.") for s in found.repairs)
    logs = [read_log_file(campaign.run_file(one.number)) for one in (found, told(campaign, right))]
    np.testing.assert_allclose(logs[0]["q"], logs[1]["q"], atol=1e-9)


def test_what_a_repair_does_not_put_right_is_refused(
    campaign: Campaign, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = changed(campaign, tmp_path / "log.csv", 1, tau_hip=-1.0)
    monkeypatch.setattr("etude.campaign.ingest.command_decisions.repaired", lambda log, _: log)
    with pytest.raises(DataError, match="commands of hip is inverted"):
        told(campaign, path, repair=("sign",))


@pytest.mark.parametrize("answers", [{"accept": ("sing",)}, {"repair": ("degrees",)}])
def test_there_is_no_such_answer(campaign: Campaign, tmp_path: Path, answers: dict[str, tuple[str]]) -> None:
    path = write_log(tmp_path / "log.csv", random_motion(campaign, 1))
    with pytest.raises(UsageError, match="no check"):
        told(campaign, path, **answers)


def test_the_command_line_asks_and_takes_the_answer(campaign: Campaign, tmp_path: Path, capsys) -> None:
    path = changed(campaign, tmp_path / "log.csv", 1, tau_hip=-1.0)
    assert main(["tell", str(campaign.path), str(path), "--foreign"]) == 3
    assert "--repair sign" in capsys.readouterr().err


def test_a_clock_that_is_off_is_refused_wherever_logs_are_read(campaign: Campaign, tmp_path: Path) -> None:
    path = write_log(tmp_path / "log.csv", random_motion(campaign, 1), start=0.0)
    lines = path.read_text().splitlines()
    rows = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    speed = np.gradient(rows[:, 1:3], rows[:, 0], axis=0)
    table = np.column_stack([2.0 * rows[:, :1], rows[:, 1:], speed])
    text = [f"{lines[0]},qd_hip,qd_knee", *(",".join(map(repr, row)) for row in table.tolist())]
    path.write_text("\n".join(text) + "\n")
    for read in (lambda: etude.read_log(path, campaign), lambda: told(campaign, path)):
        with pytest.raises(DataError, match="2 times too slow"):
            read()
    found = told(campaign, path, repair=("time",))
    assert "Times were divided by 2, as asked." in found.repairs
    log = read_log_file(campaign.run_file(found.number))
    assert np.median(np.diff(log.t)) == pytest.approx(0.02)


def test_a_command_that_was_not_recorded_is_no_gravity_taken_out(tmp_path: Path) -> None:
    """By its model file the robot has weight, which a constant command does not hold."""
    ur10 = Path(__file__).parents[3] / "examples" / "ur10"
    campaign, _ = etude.create_campaign(tmp_path / "lab", ur10 / "ur10.toml")
    table = pl.read_csv(ur10 / "ur10_exciting.csv").head(1500)
    table = table.with_columns(pl.lit(0.0).alias(n) for n in table.columns if n.endswith(".effort"))
    table.write_csv(tmp_path / "log.csv")
    with pytest.raises(
        DataError, match=r"command of shoulder_pan_joint, .* is constant although the joint moved"
    ):
        read_told(campaign, tmp_path / "log.csv")


def tower(links: Sequence[tuple[float, float]]) -> str:
    """A URDF of links on top of one another, each with mass and moments of inertia."""
    parts = ['<link name="l0"/>']
    for k, (mass, moment) in enumerate(links, 1):
        moments = " ".join(f'i{a}{a}="{moment}"' for a in "xyz")
        parts.append(
            f'<link name="l{k}"><inertial><origin xyz="0 0 0.1"/><mass value="{mass}"/>'
            f'<inertia {moments} ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="j{k}" type="revolute"><parent link="l{k - 1}"/><child link="l{k}"/>'
            f'<origin xyz="0 0 0.3"/><axis xyz="{"0 1 0" if k % 2 else "0 0 1"}"/>'
            '<limit lower="-1.2" upper="1.2" velocity="1" effort="50"/></joint>'
        )
    return f'<robot name="tower">{"".join(parts)}</robot>'


@pytest.mark.parametrize("links", [((1.0, 1.0),) * 3, ((3.0, 0.02), (2.0, 0.01), (1.0, 0.005))])
def test_a_file_of_placeholders_judges_no_commands(
    links: tuple[tuple[float, float], ...], tmp_path: Path
) -> None:
    """Commands a tenth of the file's are of another unit; where its masses are made up they may be right."""
    (tmp_path / "arm.urdf").write_text(tower(links))
    spec = etude.load_robot(tmp_path / "arm.urdf")
    t = np.arange(0.0, 20.0, 0.01)
    turns = np.array([0.31, 0.23, 0.17]) * 2.0 * np.pi
    angle = np.outer(t, turns)
    orders = (0.8 * np.sin(angle), 0.8 * turns * np.cos(angle), -0.8 * turns**2 * np.sin(angle))
    log = Log(t, {}, {}, "a.csv")
    for channel, values in zip(ARM.channels(spec), orders, strict=False):
        log = log.put(channel, values)
    body, made_up = body_of(ARM, spec), links[0] == (1.0, 1.0)
    assert body is not None
    command = next(c for c in ARM.channels(spec) if c.role == "command")
    (found,) = unit_findings(ARM, spec, log.put(command, 0.1 * body.predict(log)))
    assert ("placeholders" in found.sentence, found.flag) == ((True, "") if made_up else (False, "scale"))


LIFT = """<robot name="lift"><link name="base"/>
<joint name="up" type="prismatic"><parent link="base"/><child link="car"/><origin xyz="0 0 1"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="200"/></joint>
<link name="car"><inertial><mass value="4"/>INERTIA</inertial></link>
<joint name="arm" type="revolute"><parent link="car"/><child link="fore"/>
<axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5" velocity="3" effort="90"/></joint>
<link name="fore"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>INERTIA</inertial></link>
<joint name="wrist" type="revolute"><parent link="fore"/><child link="hand"/><origin xyz="0.4 0 0"/>
<axis xyz="1 0 0"/><limit lower="-2" upper="2" velocity="3" effort="9"/></joint>
<link name="hand"><inertial><mass value="1"/>INERTIA</inertial></link></robot>
""".replace("INERTIA", '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>')


def lift_log(spec: Any) -> Log:
    """All joints move; weight, inertia and friction are in the commands."""
    noise = np.random.default_rng(5).standard_normal((2, 600, 3))
    t = 0.02 * np.arange(600)
    turns, size = np.array([0.31, 0.43, 0.23]) * 2.0 * np.pi, np.array([0.25, 0.7, 0.9])
    angle = np.outer(t, turns) + np.array([0.3, 1.1, 2.0])
    q, qd, qdd = size * np.sin(angle), size * turns * np.cos(angle), -size * turns**2 * np.sin(angle)
    weight = np.column_stack([np.full(len(t), 69.0), -7.8 * np.cos(q[:, 1]), np.zeros(len(t))])
    friction = [5.0, 1.0, 0.4] * np.tanh(qd / 0.01)
    log, channels = Log(t, {}, {}, "a.csv"), ARM.channels(spec)
    values = {"q": q + 1e-5 * noise[1], "qd": qd + 1e-4 * noise[1]}
    for channel in channels:
        if channel.role == "command":
            log = log.put(channel, [7.0, 0.5, 0.1] * qdd + weight + friction + 0.02 * noise[0])
        elif channel.name in values:
            log = log.put(channel, values[channel.name])
    return log


@pytest.mark.parametrize("columns", [("q", "qd"), pytest.param(("command",), marks=pytest.mark.slow)])
def test_a_lift_beside_a_file_of_placeholders_is_asked_about_and_not_turned(
    columns: tuple[str, ...], tmp_path: Path
) -> None:
    """An inverted encoder looks like an inverted command, and a command that is turned for it is wrong."""
    (tmp_path / "lift.urdf").write_text(LIFT)
    spec = etude.load_robot(tmp_path / "lift.urdf")
    wrong = lift_log(spec)
    for name in columns:
        wrong = wrong.put(wrong.channels[name], wrong[name] * [-1.0, 1.0, 1.0])
    (found,) = (one for one in judged_commands(ARM, spec, wrong) if one.flag == "sign")
    assert "--repair" not in found.step
    assert "commands of up" in found.sentence
    assert "positions of up" in found.sentence
    # without a file the positions say what is forwards, and the command follows them
    alone = replace(spec, model_file=None)
    (found,) = (one for one in judged_commands(ARM, alone, wrong) if one.flag == "sign")
    assert "--repair sign" in found.step


def test_a_mounting_written_after_init_turns_gravity_and_is_told(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(tower(((3.0, 0.02), (2.0, 0.01), (1.0, 0.005))))
    lab = etude.create_campaign(tmp_path / "lab", tmp_path / "arm.urdf")[0]

    def weight(campaign: Campaign) -> np.ndarray:
        still = Log(np.arange(3.0), {}, {}, "still")
        for channel, values in zip(
            campaign.channels, (0.5 * np.ones((3, 3)), *2 * [np.zeros((3, 3))]), strict=False
        ):
            still = still.put(channel, values)
        body = body_of(campaign.kind, campaign.spec)
        assert body is not None
        return body.predict(still)

    upright = weight(lab)
    with (lab.path / "robot.toml").open("a") as file:
        file.write(f"\n[mounting]\nposition = [0.0, 0.0, 2.0]\nrotation = [{np.pi}, 0.0, 0.0]\n")
    hanging = etude.open_campaign(lab.path)
    np.testing.assert_allclose(weight(hanging), -upright, atol=1e-9)
    assert np.abs(upright).max() > 1.0
    (told,) = etude.status(hanging)["edited"]
    assert "robot.toml was edited" in told["sentence"]
    assert hanging.kind.body(hanging.spec) != lab.kind.body(lab.spec)
