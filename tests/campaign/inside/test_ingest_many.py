"""Many logs at once: each is taken in or refused by itself, and all are learned together; logs taken back."""

from __future__ import annotations

import itertools
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from small_robot import make_campaign, random_motion, stub_learner, write_log

from etude import ask, status, tell, untell
from etude.campaign import (
    Campaign,
    IngestResult,
    abandon,
    event_to_json,
    open_campaign,
    replay,
    stored_trajectory,
)
from etude.campaign.ingest.tell import IngestedMany
from etude.campaign.record.journal import damaged_files
from etude.cli import main
from etude.errors import DataError, UsageError

pytestmark = pytest.mark.as_logged


def many(campaign: Campaign, paths: list[Path], **options: Any) -> IngestedMany:
    found = tell(campaign, paths, **{"learner": stub_learner, **options})
    assert isinstance(found, IngestedMany)
    return found


def logs_of(campaign: Campaign, folder: Path, count: int) -> list[Path]:
    """Asks `count` times and writes the answers."""
    numbers = [ask(campaign, new=True, learner=stub_learner).number for _ in range(count)]
    return [write_log(folder / f"run{n}.csv", stored_trajectory(campaign, n), n) for n in numbers]


def outcomes(found: IngestedMany) -> dict[str, str]:
    return {file.path.name: file.sentence.split(":")[0] for file in found.files}


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign with two trajectories asked for, and the files of `mixed` beside it."""
    folder = tmp_path_factory.mktemp("asked")
    campaign = make_campaign(folder)
    logs_of(campaign, folder, 2)
    write_log(folder / "a_foreign.csv", random_motion(campaign, 99))
    (folder / "bad.csv").write_text("no log")
    return folder


@pytest.fixture
def campaign(asked: Path, tmp_path: Path) -> Campaign:
    shutil.copytree(asked, tmp_path, dirs_exist_ok=True)
    return open_campaign(tmp_path / "lab")


@pytest.fixture
def mixed(campaign: Campaign, tmp_path: Path) -> list[Path]:
    """Two answers, a motion that nobody asked for, a file that is no log and one that is not there."""
    names = ("run1.csv", "run2.csv", "a_foreign.csv", "bad.csv", "nothing.csv")
    return [tmp_path / name for name in names]


def test_each_is_taken_in_by_itself_and_all_in_one_training(campaign: Campaign, mixed: list[Path]) -> None:
    found = many(campaign, mixed)
    assert outcomes(found) == {
        "run1.csv": "answered 1",
        "run2.csv": "answered 2",
        "a_foreign.csv": "foreign, as 3",
        "bad.csv": "refused",
        "nothing.csv": "refused",
    }
    assert found.learned == (1, 2, 3)
    state = campaign.state()
    assert [r.number for r in state.trained] == [3]
    assert [r.number for r in state.learned] == [1, 2, 3]
    assert state.pending == []
    assert [e.event for e in campaign.events()].count("trained") == 1
    assert {t["standing"] for t in status(campaign)["trajectories"]} == {"learned"}


@pytest.mark.slow
def test_the_order_of_the_files_changes_nothing(
    campaign: Campaign, mixed: list[Path], tmp_path: Path
) -> None:
    """The motion that nobody asked for is foreign whether it is read before the answers or after them."""
    told = set()
    for i, order in enumerate(itertools.permutations(mixed[:3])):
        copy = tmp_path / f"copy{i}"
        shutil.copytree(campaign.path, copy)
        other = open_campaign(copy)
        many(other, list(order))
        events = [event_to_json(replace(e, time="")) for e in other.events()]
        told.add(tuple(events))
    assert len(told) == 1


def test_told_twice_is_told_once(campaign: Campaign, mixed: list[Path]) -> None:
    many(campaign, mixed)
    before = campaign.events()
    found = many(campaign, [*mixed, *mixed])
    assert set(outcomes(found).values()) == {
        "ingested before, as 1",
        "ingested before, as 2",
        "ingested before, as 3",
        "refused",
    }
    assert len(found.files) == len(mixed)
    assert found.learned == ()
    assert campaign.events() == before


def test_interrupted_between_files_nothing_is_lost(
    campaign: Campaign, mixed: list[Path], tmp_path: Path
) -> None:
    shutil.copytree(campaign.path, tmp_path / "whole")
    whole = open_campaign(tmp_path / "whole")
    many(whole, mixed[:3])

    def dies(sentence: str) -> None:
        if sentence.startswith("run1"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        many(campaign, mixed[:3], say=dies)
    assert [r.number for r in campaign.state().pending] == [1]
    many(campaign, mixed[:3])
    assert [(e.event, e.number, e.files) for e in campaign.events()] == [
        (e.event, e.number, e.files) for e in whole.events()
    ]


def test_a_copy_replays_as_the_original(campaign: Campaign, mixed: list[Path]) -> None:
    many(campaign, mixed)
    untell(campaign, 2, learner=stub_learner)
    assert replay(campaign.events()) == campaign.state() == open_campaign(campaign.path).state()


def test_one_path_gives_one_answer_and_a_number_belongs_to_one(campaign: Campaign, mixed: list[Path]) -> None:
    assert isinstance(tell(campaign, str(mixed[0]), learner=stub_learner), IngestResult)
    with pytest.raises(UsageError, match="a number is for one log"):
        tell(campaign, mixed, number=1)


class TestUntell:
    def test_a_log_is_taken_back_and_told_again(self, campaign: Campaign, mixed: list[Path]) -> None:
        many(campaign, mixed[:3])
        files = {p: p.read_bytes() for p in campaign.path.rglob("runs/*")}
        assert untell(campaign, 1, learner=stub_learner)
        assert not untell(campaign, 1, learner=stub_learner)
        state = campaign.state()
        assert [r.number for r in state.proposals] == [1]
        assert [r.number for r in state.learned] == [2, 3]
        assert json.loads((campaign.model_folder(3) / "model.json").read_text()) == {"logs": [2, 3]}
        assert {p: p.read_bytes() for p in campaign.path.rglob("runs/*")} == files
        again = tell(campaign, mixed[0], learner=stub_learner)
        assert (again.number, again.repeated) == (1, False)
        assert [r.number for r in campaign.state().learned] == [2, 3, 1]
        assert damaged_files(campaign.path, campaign.events()) == []

    def test_another_log_in_its_place_deletes_nothing(
        self, campaign: Campaign, mixed: list[Path], tmp_path: Path
    ) -> None:
        tell(campaign, mixed[0], learner=stub_learner)
        before = {p.read_bytes() for p in campaign.path.glob("runs/*")}
        untell(campaign, 1, learner=stub_learner)
        other = write_log(tmp_path / "again.csv", stored_trajectory(campaign, 1), 77)
        assert tell(campaign, other, number=1, learner=stub_learner).number == 1
        assert before <= {p.read_bytes() for p in campaign.path.glob("runs/*")}

    def test_a_foreign_log(self, campaign: Campaign, mixed: list[Path]) -> None:
        assert tell(campaign, mixed[2], foreign=True, learner=stub_learner).number == 3
        untell(campaign, 3, learner=stub_learner)
        assert [t["standing"] for t in status(campaign)["trajectories"]] == ["open", "open", "taken back"]
        assert campaign.state().learned == []
        assert tell(campaign, mixed[2], foreign=True, learner=stub_learner).number == 4

    def test_the_last_of_several_that_were_learned_together(
        self, campaign: Campaign, mixed: list[Path]
    ) -> None:
        many(campaign, mixed)
        untell(campaign, 3, learner=stub_learner)
        assert [r.number for r in campaign.state().learned] == [1, 2]
        abandon(campaign, 2, learner=stub_learner)
        assert [r.number for r in campaign.state().learned] == [1]

    def test_what_was_never_told(self, campaign: Campaign, mixed: list[Path]) -> None:
        with pytest.raises(UsageError, match="no log of trajectory 1 was ingested"):
            untell(campaign, 1)
        with pytest.raises(UsageError, match="no trajectory 9"):
            untell(campaign, 9)

    def test_what_is_left_cannot_be_learned(self, campaign: Campaign, mixed: list[Path]) -> None:
        def picky(c: Campaign, state: Any, number: int) -> Any:
            if len(state.pending) == 1:
                raise DataError("axis hip never moved")
            return stub_learner(c, state, number)

        many(campaign, mixed[:2], learner=picky)
        with pytest.raises(DataError, match="never moved"):
            untell(campaign, 2, learner=picky)
        assert [r.number for r in campaign.state().pending] == [1]


def test_the_command_says_what_became_of_each(
    campaign: Campaign, mixed: list[Path], capsys: Any, monkeypatch: Any
) -> None:
    monkeypatch.setattr("etude.campaign.training.learn_log", stub_learner)
    assert main(["tell", str(campaign.path), *map(str, mixed), "--json"]) == 3
    data = json.loads(capsys.readouterr().out)
    assert [file["outcome"].split(":")[0] for file in data["files"]][:3] == [
        "answered 1",
        "answered 2",
        "foreign, as 3",
    ]
    assert data["files"][3]["refused"]["fact"]
    assert data["learned"] == [1, 2, 3]
    assert main(["tell", str(campaign.path), *map(str, mixed[:2])]) == 0
    assert "run1.csv  ingested before, as 1\n" in capsys.readouterr().out
    assert main(["untell", str(campaign.path), "3"]) == 0
    assert main(["tell", str(campaign.path)]) == 2


def test_a_corrected_factor_needs_the_log_anew(
    campaign: Campaign, mixed: list[Path], capsys: Any, monkeypatch: Any
) -> None:
    """The repairs printed of a repeated log are those of its first reading, and the command says so."""
    monkeypatch.setattr("etude.campaign.training.learn_log", stub_learner)
    config, log = campaign.path / "campaign.toml", mixed[0]
    header = next(name for name in log.read_text().splitlines()[0].split(",") if name.startswith("tau"))
    without = config.read_text()

    def told(factor: float, *others: Path) -> str:
        config.write_text(f'{without}\n[log.columns]\n"{header}" = "{factor} * {header}"\n')
        assert main(["tell", str(campaign.path), str(log), *map(str, others)]) == 0
        return " ".join(capsys.readouterr().out.split())

    step = f"It was not read again. After a change of [log] in campaign.toml: etude untell {campaign.path} 1,"
    first = told(0.5)
    assert f"0.5 * {header}" in first
    assert step not in first
    assert step in told(0.25)
    assert f"run1.csv: {step}" in told(0.25, mixed[1])
    assert main(["untell", str(campaign.path), "1"]) == 0
    assert f"0.25 * {header}" in told(0.25)
