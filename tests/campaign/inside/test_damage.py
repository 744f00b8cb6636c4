"""Damaged files and folders without permission: a message with a documented exit code, never a traceback."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_robot import make_campaign, write_log
from test_learning import CONFIG

from etude import ask, cli, storage, tell
from etude.campaign import Campaign, create_campaign, newest_model, open_campaign, stored_trajectory
from etude.campaign.record.journal import MODEL
from etude.codes import Notice, Warn
from etude.errors import DataError, UsageError
from etude.models import LearnedModel, load_model, save_model
from etude.trajectories import from_json

pytestmark = pytest.mark.as_logged

GARBAGE = bytes(np.random.default_rng(0).integers(0, 256, 600, dtype=np.uint8)) + b"\n"
NESTED = b"[" * 100_000 + b"\n"
Harm = Callable[[Path], object]


def folder_instead(path: Path) -> None:
    path.unlink()
    path.mkdir()


HARMS: dict[str, Harm] = {
    "missing": lambda path: path.unlink(),
    "half": lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]),
    "garbage": lambda path: path.write_bytes(GARBAGE),
    "nested": lambda path: path.write_bytes(NESTED),
    "object": lambda path: path.write_bytes(b"{}\n"),
    "folder": folder_instead,
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two logs learned, a third trajectory asked for; beside it the log that answers it."""
    folder = tmp_path_factory.mktemp("whole")
    campaign = make_campaign(folder, config=CONFIG)
    for number in (1, 2):
        ask(campaign)
        tell(campaign, write_log(folder / f"{number}.csv", stored_trajectory(campaign, number), number))
    ask(campaign)
    write_log(folder / "3.csv", stored_trajectory(campaign, 3), 3)
    return folder


@pytest.fixture
def lab(whole: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(whole / "lab", tmp_path / "lab"))


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    code = cli.main(arguments)
    words = capsys.readouterr().err
    assert "Traceback" not in words, words
    assert "bug in etude" not in words, words
    if code:
        assert "next:" in words
    return code, words


FILES = (
    *("campaign.toml", "robot.toml", "journal.jsonl", "models/0002/model.npz"),
    *("models/0001/model.npz", "proposals/0003/trajectory.json", "proposals/0003/certificate.json"),
    *("runs/0002.parquet", "runs/0002.source.toml"),
)


@pytest.mark.thinned
@pytest.mark.parametrize("harm", ["half", "garbage", "nested", "folder"])
@pytest.mark.parametrize("name", FILES)
def test_any_damaged_file(lab: Path, capsys: pytest.CaptureFixture[str], name: str, harm: str) -> None:
    HARMS[harm](lab / name)
    for command in ("status", "report", "ask"):
        assert said(capsys, command, str(lab))[0] in (0, 2, 3)


RARE = ("garbage", "nested", "object", "folder")
TOLD = [pytest.param(own, marks=[pytest.mark.slow] * (own in RARE)) for own in HARMS]
"""Every day those that differ when a log is told; `test_any_damaged_file` reads the others."""


@pytest.mark.parametrize("harm", TOLD)
def test_a_damaged_proposal(lab: Path, whole: Path, capsys: pytest.CaptureFixture[str], harm: str) -> None:
    """Its own log cannot answer it; and once it is given up, it stands in the way of no other."""
    path = lab / "proposals" / "0003" / "trajectory.json"
    HARMS[harm](path)
    tell = ["tell", str(lab), str(whole / "3.csv"), "--number", "3"]
    if harm != "missing":
        code, words = said(capsys, *tell)
        assert code == 2
        assert f"where: {path}" in words
    assert said(capsys, "abandon", str(lab), "3")[0] == 0
    code, words = said(capsys, *tell[:-2])
    assert code == 0, words
    assert [r.number for r in open_campaign(lab).state().ingested] == [1, 2, 4]


@pytest.mark.thinned
@pytest.mark.parametrize("command", ["status", "ask", "report"])
@pytest.mark.parametrize(
    "data",
    [GARBAGE, NESTED, b"\xff\xfe\n", b"\0\0\0\n", b'{"event": "caf\xe9"}\n'],
    ids=lambda data: data[:5],
)
def test_a_journal_that_is_no_text(
    lab: Path, capsys: pytest.CaptureFixture[str], command: str, data: bytes
) -> None:
    journal = lab / "journal.jsonl"
    journal.write_bytes(data)
    code, words = said(capsys, command, str(lab))
    assert code == 2
    assert "this journal has no hashes" in words.lower()
    assert f"where: {journal}:1" in words


@pytest.mark.parametrize("harm", TOLD)
def test_a_damaged_model(lab: Path, whole: Path, capsys: pytest.CaptureFixture[str], harm: str) -> None:
    HARMS[harm](lab / "models" / "0002" / MODEL)
    for command in (["ask", str(lab), "--new"], ["tell", str(lab), str(whole / "3.csv")]):
        code, words = said(capsys, *command)
        assert code == 2
        assert f"odels/0002/{MODEL}" in words
        assert f"etude abandon {lab} 2, then ingest its log again" in words
    if harm == "missing":  # the advice holds
        assert said(capsys, "abandon", str(lab), "2")[0] == 0
        assert said(capsys, "tell", str(lab), str(whole / "2.csv"), "--number", "2")[0] == 0
        assert said(capsys, "ask", str(lab), "--new")[0] == 0


def loaded(campaign: Campaign, path: Path) -> LearnedModel:
    """A model file, read without asking the journal."""
    inputs = campaign.kind.inputs(campaign.spec, campaign.config)
    return load_model(path, inputs.restore, campaign.kind.physics(campaign.spec, campaign.config))


CHANGED = (Notice(Warn.STATED, {"sentence": "changed"}),)


def test_a_model_that_was_changed_and_still_loads(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    campaign = open_campaign(lab)
    save_model(
        lab / "models" / "0002" / MODEL,
        replace(newest_model(campaign, campaign.state()), calibrated=True, warnings=CHANGED),
    )
    assert loaded(campaign, lab / "models" / "0002" / MODEL).warnings == CHANGED
    code, words = said(capsys, "ask", str(lab), "--new")
    assert code == 2
    assert "models/0002/model.npz was changed after Étude stored it" in words


def test_any_bytes_of_a_model(whole: Path, tmp_path: Path) -> None:
    campaign = open_campaign(whole / "lab")
    data, rng, refused = (campaign.model_folder(2) / MODEL).read_bytes(), np.random.default_rng(1), 0
    for _ in range(300):
        changed = bytearray(data)
        for place in rng.integers(len(data), size=3):
            changed[place] = rng.integers(256)
        (tmp_path / MODEL).write_bytes(changed)
        try:
            loaded(campaign, tmp_path / MODEL)
        except DataError:
            refused += 1
    assert refused > 200


def ask_for_patches(data: bytes) -> bytes:
    """Sets the flag of a zip feature that no reader has, in the directory's first entry."""
    changed = bytearray(data)
    changed[changed.index(b"PK\x01\x02") + 8] |= 0x20
    return bytes(changed)


@pytest.mark.parametrize(
    "harm", [ask_for_patches, lambda data: data.replace(b"False", b"[alse", 1)], ids=["zip", "array header"]
)
def test_what_readers_raise_of_their_own(whole: Path, tmp_path: Path, harm: Callable[[bytes], bytes]) -> None:
    campaign = open_campaign(whole / "lab")
    path = tmp_path / MODEL
    path.write_bytes(harm((campaign.model_folder(2) / MODEL).read_bytes()))
    with pytest.raises(DataError, match="not a readable model"):
        loaded(campaign, path)


def test_a_trajectory_nested_too_deeply() -> None:
    with pytest.raises(UsageError, match="not JSON"):
        from_json(NESTED)


@pytest.mark.parametrize("command", ["status", "ask", "report", "abandon", "tell", "simulate"])
def test_a_file_where_a_folder_should_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "log.csv").write_text("time\n")
    more = {"abandon": ["1"], "tell": [str(tmp_path / "log.csv")]}.get(command, [])
    for folder in (tmp_path / "file", tmp_path / "file" / "lab"):
        assert said(capsys, command, str(folder), *more)[0] == 2


@pytest.mark.parametrize("below", ["", "lab", "deep/lab"])
def test_a_campaign_below_a_file(tmp_path: Path, below: str) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match="this path is a file"):
        create_campaign(tmp_path / "file" / below, "arm4")


def deny(patch: pytest.MonkeyPatch, owner: Any, name: str, which: Callable[[Path], bool]) -> None:
    """Makes a call refuse the paths that `which` says, as the system does for anyone but root."""
    real = getattr(owner, name)

    def call(path: Any, *args: Any, **kwargs: Any) -> Any:
        if not isinstance(path, int) and which(Path(path)):
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return real(path, *args, **kwargs)

    patch.setattr(owner, name, call)


@pytest.mark.thinned
@pytest.mark.parametrize("name", ["campaign.toml", "journal.jsonl"])
@pytest.mark.parametrize("command", ["status", "ask", "report"])
def test_a_file_that_may_not_be_read(
    lab: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str, command: str
) -> None:
    deny(monkeypatch, Path, "read_bytes", lambda path: path.name == name)
    code, words = said(capsys, command, str(lab))
    assert code == 2
    assert "Could not read: Permission denied" in words
    assert str(lab / name) in words


@pytest.mark.parametrize("command", [["ask", "--new"], ["abandon", "3"], ["tell", "LOG"], ["report"]])
def test_a_folder_that_may_not_be_written(
    lab: Path,
    whole: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    command: list[str],
) -> None:
    before = (lab / "journal.jsonl").read_bytes()
    deny(monkeypatch, storage.os, "open", lambda path: lab in path.parents)
    more = [str(whole / "3.csv") if word == "LOG" else word for word in command[1:]]
    code, words = said(capsys, command[0], str(lab), *more)
    assert code == 1
    assert "Could not write: Permission denied" in words
    assert (lab / "journal.jsonl").read_bytes() == before


def test_a_log_that_may_not_be_read(
    lab: Path, whole: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import builtins

    deny(monkeypatch, builtins, "open", lambda path: path.name == "3.csv")
    code, words = said(capsys, "tell", str(lab), str(whole / "3.csv"))
    assert code == 3
    assert "The log file cannot be read: Permission denied" in words


def test_a_folder_that_may_not_be_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    deny(monkeypatch, os, "mkdir", lambda path: path.name == "lab")
    with pytest.raises(UsageError, match=r"cannot be made: Permission denied .*lab.* Name another folder"):
        create_campaign(tmp_path / "lab", "arm4")


def test_a_proposal_that_may_not_be_read(lab: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    campaign = open_campaign(lab)
    deny(monkeypatch, Path, "read_bytes", lambda path: path.name == "trajectory.json")
    with pytest.raises(UsageError, match=r"could not read: Permission denied .*trajectory\.json"):
        stored_trajectory(campaign, 3)


def test_what_nobody_foresaw_is_the_machines_failing(
    lab: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.EIO, "Input/output error", "/dev/somewhere")

    monkeypatch.setattr("etude.campaign.evaluate.status.status", refuse)
    code, words = said(capsys, "status", str(lab))
    assert code == 1
    assert "The operating system refused: Input/output error" in words
    assert "where: /dev/somewhere" in words
