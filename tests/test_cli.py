"""The command line: exit codes, one clear block of words for people, one line of JSON for machines."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import etude
from etude import cli
from etude.campaign import TrainingOutcome, open_campaign, stored_trajectory
from etude.errors import UnsafeTrajectoryError
from etude.storage import writer_lock
from journal_facts import trained

COMMANDS = [
    *("init", "ask", "tell", "abandon", "status", "report", "simulate", "demo"),
    *("bench", "study", "plugins"),
]


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of the simulated arm with one trajectory asked for."""
    folder = tmp_path_factory.mktemp("asked") / "lab"
    assert cli.main(["init", str(folder), "--robot", "arm4", "--seed", "2"]) == 0
    assert cli.main(["ask", str(folder)]) == 0
    return folder


@pytest.fixture
def lab(asked: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    """A copy of it; what making it said is not what a test reads."""
    capsys.readouterr()
    return Path(shutil.copytree(asked, tmp_path / "lab"))


def run_json(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, Any]]:
    code = cli.main([*arguments, "--json"])
    out = capsys.readouterr().out
    assert out.count("\n") == 1, "exactly one line on stdout"
    found = json.loads(out)
    assert isinstance(found, dict)
    return code, found


def run_csv(lab: Path, path: Path) -> Path:
    """A log of the first proposal."""
    campaign = open_campaign(lab)
    t = np.arange(0.0, 60.0, 0.01)
    q, qd = stored_trajectory(campaign, 1).motion(t, 2).orders
    tau = 100.0 * np.tanh(qd / 0.02) + 50.0 * q
    names = campaign.axes
    header = ",".join(["time", *(f"{kind}_{name}" for kind in ("q", "tau") for name in names)])
    np.savetxt(path, np.column_stack([t, q, tau]), delimiter=",", header=header, comments="")
    return path


def stub_learning(monkeypatch: pytest.MonkeyPatch) -> None:
    """Learning costs nothing and says that the tolerance is reached."""

    def learn(campaign: Any, state: Any, number: int) -> TrainingOutcome:
        low = [0.001] * len(campaign.axes)
        scores = {"gp": {"nmse": low, "z2": [None] * len(low), "coverage": [0.95] * len(low)}}
        facts = {"forecast_deviation": low, "latent_deviation": low, "noise_deviation": [1e-9] * len(low)}
        facts |= {"chosen": "gp", "rungs": ["gp"] * len(low), "robot_seconds": 60.0, "moved": None}
        return TrainingOutcome([], trained(models=scores, **facts))

    monkeypatch.setattr("etude.campaign.training.learn_log", learn)


def test_every_command_explains_itself(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(command in text for command in COMMANDS)
    for command in COMMANDS:
        assert cli.main([command, "--help"]) == 0
        assert "--json" in capsys.readouterr().out


def test_from_init_to_ask_in_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = str(tmp_path / "lab")
    code, made = run_json(capsys, "init", folder, "--robot", "arm4", "--seed", "3")
    assert (code, made["seed"], made["axes"]) == (0, 3, ["waist", "shoulder", "elbow", "wrist"])
    code, asked = run_json(capsys, "ask", folder)
    assert (code, asked["number"], asked["new"], asked["certified"]) == (0, 1, True, True)
    assert min(asked["slack"].values()) >= 0
    assert all(Path(name).is_file() for name in asked["files"])
    code, again = run_json(capsys, "ask", folder)
    assert (code, again["number"], again["new"]) == (0, 1, False)
    code, standing = run_json(capsys, "status", folder)
    assert (code, standing["trajectories"][0]["standing"], standing["verdict"]["stop"]) == (0, "open", False)
    code, gone = run_json(capsys, "abandon", folder, "1")
    assert (code, gone) == (0, {"number": 1, "changed": True})


def test_the_same_words_for_people(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["ask", str(lab), "--speed", "25"]) == 0
    out = capsys.readouterr().out
    assert "Proved for all times; at rest at both ends" in out
    assert "speed_025/trajectory.csv" in out
    assert cli.main(["status", str(lab)]) == 0
    assert "arm4 (waist, shoulder, elbow, wrist), preset default, seed 2" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "code", "fact"),
    [
        (["dance"], 2, "there is no command 'dance'"),
        (["ask"], 2, "Missing from etude ask: FOLDER"),
        (["ask", "LAB", "--speed", "30"], 2, "--speed cannot be '30'"),
        (["ask", "LAB", "--colour"], 2, "Unrecognized options: --colour"),
        (["ask", "nowhere"], 2, "there is no campaign here"),
        (["init", "LAB", "--robot", "arm4"], 2, "this folder already holds a campaign"),
        (["init", "", "--robot", "arm4"], 2, "an argument is empty"),
        (["init", "new", "--robot", "nobody"], 2, "there is no robot and no file 'nobody'"),
        (["init", "new", "--robot", "arm4", "--seed", "-1"], 2, "the seed must be 0 or more"),
        (["init", "new", "--robot", "arm4", "--preset", "best"], 2, "unknown preset 'best'"),
        (["init", "new", "--robot", "."], 2, "this is a folder, not a robot's description"),
        (["init", "new", "--robot", "empty.csv"], 2, "this file describes no known kind of robot"),
        (["tell", "LAB", "nothing.csv"], 3, "there is no such log file"),
        (["tell", "LAB", "EMPTY"], 3, "the log file is empty"),
        (["tell", "LAB", "LOG", "--number", "9"], 2, "there is no trajectory 9"),
        (["abandon", "LAB", "9"], 2, "there is no trajectory 9"),
        (["ask", "LAB", "--new", "--tasks", "nothing.json"], 2, "the task file cannot be read"),
        (["simulate", "LAB", "--rounds", "-1"], 2, "the number of rounds"),
    ],
)
def test_errors_have_codes_and_words(
    lab: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    code: int,
    fact: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty.csv").touch()
    log = run_csv(lab, tmp_path / "log.csv") if "LOG" in arguments else None
    names = {"LAB": str(lab), "EMPTY": "empty.csv", "LOG": str(log)}
    events = (lab / "journal.jsonl").read_bytes()
    found, error = run_json(capsys, *(names.get(a, a) for a in arguments))
    assert found == code
    assert error["error"]["fact"].startswith(fact)
    assert error["error"]["exit_code"] == code
    assert (lab / "journal.jsonl").read_bytes() == events
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("arguments", "fact", "step"),
    [
        (["export", "LAB", "--to", "c", "--rate", "fast"], "--rate cannot be 'fast'", "Write --rate NUMBER."),
        (["init", "new", "--robot", "arm4", "--seed", "x"], "--seed cannot be 'x'", "Write --seed N."),
        (["ask", "LAB", "--speed", "30"], "--speed cannot be '30'", "Write one of 25, 50, 100."),
        (
            ["export", "LAB", "--to", "c", "--real", "half"],
            "--real cannot be 'half'",
            "Write one of float, double.",
        ),
        (["payload", "LAB"], "Missing from etude payload: --log PATH", ""),
        (["payload"], "Missing from etude payload: FOLDER --log PATH", ""),
        (["run", "LAB", "--on"], "--on has no value", ""),
        (
            ["export", "LAB", "--to", "c", "--fade"],
            "Unrecognized options: --fade",
            "Perhaps you meant: --no-fade.",
        ),
    ],
)
def test_a_parser_error_is_short_and_without_the_help(
    lab: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], fact: str, step: str
) -> None:
    code, error = run_json(capsys, *(str(lab) if a == "LAB" else a for a in arguments))
    named = error["error"]
    assert (code, named["fact"]) == (2, fact)
    assert named["next_step"] == f"{step} etude {arguments[0]} --help lists the options.".strip()


def test_a_wrong_value_is_answered_with_the_help(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, error = run_json(capsys, "simulate", str(lab), "--rounds", "-1")
    assert (code, error["error"]["next_step"]) == (2, "etude simulate --help says what each option takes.")


def test_a_wrong_option_is_answered_with_the_nearest(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, error = run_json(capsys, "ask", str(lab), "--sped", "25")
    assert (code, error["error"]["where"]) == (2, "etude ask")
    assert error["error"]["next_step"].startswith("Perhaps you meant: --speed")


def test_an_error_is_one_block(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert cli.main(["status", str(tmp_path)]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    lines = captured.err.splitlines()
    assert lines[0] == "etude: There is no campaign here"
    assert [line.split(":")[0].strip() for line in lines[1:]] == ["where", "next"]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("harmonics", "harmonix", "unknown key 'harmonix'"),
        ("harmonics = 5", "harmonics = 0", "harmonics >= 1"),
    ],
)
def test_a_badly_edited_campaign(
    lab: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, words: str
) -> None:
    path = lab / "campaign.toml"
    path.write_text(path.read_text().replace(old, new, 1))
    for command in (["ask"], ["status"], ["report"]):
        code, found = run_json(capsys, *command, str(lab))
        assert code == 2
        assert words in json.dumps(found)
        assert "campaign.toml" in found["error"]["where"]


def test_min_above_max_in_the_robot(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = lab / "robot.toml"
    path.write_text(path.read_text().replace("upper = 0.7854", "upper = -3.0"))
    code, found = run_json(capsys, "ask", str(lab))
    assert code == 2
    assert "waist" in json.dumps(found)


def test_telling_and_stopping(
    lab: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stub_learning(monkeypatch)
    log = run_csv(lab, tmp_path / "run.csv")
    code, told = run_json(capsys, "tell", str(lab), str(log))
    assert (code, told["number"], told["learned"]) == (0, 1, [1])
    code, again = run_json(capsys, "tell", str(lab), str(log))
    assert (code, again["repeated"], again["learned"]) == (0, True, [])
    path = lab / "campaign.toml"
    path.write_text(path.read_text().replace("budget_trajectories = 20", "budget_trajectories = 1"))
    code, found = run_json(capsys, "ask", str(lab))
    assert (code, found["error"]["kind"]) == (5, "StopRuleReached")
    assert "--continue" in found["error"]["next_step"]
    assert len(list((lab / "proposals").iterdir())) == 1
    code, standing = run_json(capsys, "status", str(lab))
    assert standing["verdict"]["rule"] == "budget"


def test_an_unsafe_trajectory_is_4(
    lab: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def unsafe(*_: object) -> None:
        raise UnsafeTrajectoryError("position of joint 'waist' may reach 9")

    monkeypatch.setattr("etude.campaign.propose.ask.proposed", unsafe)
    code, found = run_json(capsys, "ask", str(lab), "--new")
    assert (code, found["error"]["kind"]) == (4, "UnsafeTrajectoryError")
    assert [p.name for p in (lab / "proposals").iterdir()] == ["0001"]


def test_an_interrupt_is_130(
    lab: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("etude.campaign.propose.ask.ask", interrupted)
    code, found = run_json(capsys, "ask", str(lab))
    assert (code, found["error"]["kind"]) == (130, "Interrupted")
    assert "is kept" in found["error"]["fact"]


def test_a_bug_says_so(
    lab: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("oh")

    monkeypatch.setattr("etude.campaign.evaluate.status.status", broken)
    code, found = run_json(capsys, "status", str(lab))
    assert (code, found["error"]["kind"]) == (1, "Bug")
    assert "ZeroDivisionError: oh" in found["error"]["fact"]


def test_a_second_writer_is_told(
    lab: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("etude.campaign.record.folder.WAIT_S", 0.0)
    with writer_lock(lab):
        code, found = run_json(capsys, "ask", str(lab))
        assert code == 2
        assert "another process is writing" in found["error"]["fact"]
        assert run_json(capsys, "status", str(lab))[0] == 0


def test_as_a_program(tmp_path: Path) -> None:
    """Exit codes reach the shell, and a reader that goes away is no error."""
    call = [sys.executable, "-m", "etude"]
    done = subprocess.run([*call, "status", str(tmp_path)], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("etude: There is no campaign here")
    read_end, write_end = os.pipe()
    os.close(read_end)
    subprocess.run([*call, "init", str(tmp_path / "lab"), "--robot", "arm4"], stdout=write_end, check=True)
    os.close(write_end)


@pytest.mark.parametrize("first", [pytest.param("random", marks=pytest.mark.slow), "designed"])
def test_asking_loads_nothing_it_does_not_need(lab: Path, first: str) -> None:
    config = lab / "campaign.toml"
    text = config.read_text()
    for old, new in (('first = "designed"', f'first = "{first}"'), ("candidates = 24", "candidates = 2")):
        assert old in text
        text = text.replace(old, new)
    config.write_text(text)
    code = (
        "import sys; from etude import cli; assert cli.main(sys.argv[1:]) == 0\n"
        "heavy = {'etude.campaign.training', 'mujoco', 'numba', 'plotly', 'polars'}\n"
        "print(sorted(heavy & set(sys.modules)), file=sys.stderr)"
    )
    command = [sys.executable, "-c", code, "ask", str(lab), "--new"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stderr.splitlines()[-1] == "[]"


def test_the_version_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"etude {etude.__version__}\n"


def test_plug_ins_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    code, found = run_json(capsys, "plugins")
    rows = {(row["group"], row["name"]): row for row in found["plugins"]}
    assert code == 0
    assert rows["etude.robots", "arm"]["source"] == "etude"
    assert cli.main(["plugins"]) == 0
    text = capsys.readouterr().out
    assert all(group in text for group in ("etude.robots", "etude.kernels", "etude.exporters", "ros2_yaml"))


@pytest.mark.parametrize("command", [["bench", "gp"], ["study", "list"], ["study", "run", "thesis"]])
def test_without_the_studies_their_commands_say_how_to_install_them(
    command: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("etude.plugins.names", lambda group: ())
    assert cli.main(command) == 2
    said = capsys.readouterr().err
    assert "are in a separate package, etude-studies" in said
    assert "pip install ./packages/etude-studies" in said
