"""Another robot than the last: its log waits, the user is asked, each answer does what it says."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_robot import command_of, make_campaign, random_motion, write_log
from test_learning import CONFIG

from etude import status, tell
from etude.campaign import Campaign, open_campaign
from etude.cli import main
from etude.errors import UsageError
from etude.types import Array

pytestmark = pytest.mark.as_logged

CHANGES: dict[str, Callable[[Array, Array, Array], Array]] = {
    "a load was taken up": lambda q, qd, qdd: command_of(q, qd, qdd) + 1.5 * np.sin(q) + 0.7 * qdd,
    "friction has changed": lambda q, qd, qdd: command_of(q, qd, qdd) + 1.0 * np.tanh(qd / 0.05),
    "the errors are constant": lambda q, qd, qdd: command_of(q, qd, qdd) + 0.8,
}


def write_changed(path: Path, campaign: Campaign, seed: int, change: Callable[..., Array]) -> Path:
    """The log of a motion of the pair that is another one now."""
    import small_robot

    before = small_robot.command_of
    small_robot.command_of = change  # type: ignore[assignment]
    try:
        return write_log(path, random_motion(campaign, seed), seed)
    finally:
        small_robot.command_of = before


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """Three logs of the unchanged pair, learned together."""
    folder = tmp_path_factory.mktemp("changed")
    campaign = make_campaign(folder, config=CONFIG)
    logs = [write_log(folder / f"{seed}.csv", random_motion(campaign, seed), seed) for seed in (1, 2, 3)]
    tell(campaign, logs, foreign=True)
    return campaign


@pytest.fixture
def fresh(known: Campaign, tmp_path: Path) -> Campaign:
    shutil.copytree(known.path, tmp_path / "lab")
    return open_campaign(tmp_path / "lab")


def learned(campaign: Campaign) -> list[int]:
    return [r.number for r in campaign.state().learned]


def test_an_unchanged_robot_is_learned(fresh: Campaign, tmp_path: Path) -> None:
    told = tell(fresh, write_log(tmp_path / "4.csv", random_motion(fresh, 4), 4))
    assert (told.awaits_answer, told.findings, told.learned) == (False, (), (4,))


@pytest.mark.thinned(2)
@pytest.mark.parametrize("words", CHANGES)
def test_a_changed_one_waits_and_is_named(fresh: Campaign, tmp_path: Path, words: str) -> None:
    model = (fresh.model_folder(3) / "model.npz").read_bytes()
    log = write_changed(tmp_path / "4.csv", fresh, 4, CHANGES[words])
    told = tell(fresh, log)
    assert (told.awaits_answer, told.learned) == (True, ())
    (finding,) = told.findings
    assert (finding.check, finding.light, finding.flag) == ("changed robot", "red", "--changed")
    assert words in finding.sentence
    assert "--changed new" in finding.step
    assert learned(fresh) == [1, 2, 3]
    assert (fresh.model_folder(3) / "model.npz").read_bytes() == model
    assert status(fresh)["trajectories"][3]["standing"] == "waits for an answer"
    again = tell(fresh, log)
    assert (again.repeated, again.awaits_answer, again.findings) == (True, True, told.findings)
    assert open_campaign(fresh.path).state() == fresh.state()


@pytest.fixture
def waiting(fresh: Campaign, tmp_path: Path) -> Path:
    log = write_changed(tmp_path / "4.csv", fresh, 4, CHANGES["friction has changed"])
    assert tell(fresh, log).awaits_answer
    return log


def test_same_learns_it_with_the_others(fresh: Campaign, waiting: Path) -> None:
    told = tell(fresh, waiting, changed="same")
    assert (told.repeated, told.awaits_answer, told.learned) == (True, False, (4,))
    assert learned(fresh) == [1, 2, 3, 4]
    before = fresh.events()
    tell(fresh, waiting, changed="same")
    assert fresh.events() == before


def test_forget_sets_it_aside(fresh: Campaign, waiting: Path, capsys: Any) -> None:
    told = tell(fresh, waiting, changed="forget")
    assert (told.learned, told.excluded, told.awaits_answer) == ((), True, False)
    assert main(["tell", str(fresh.path), str(waiting)]) == 0
    assert f"Log {told.number} is excluded from training." in capsys.readouterr().out
    assert learned(fresh) == [1, 2, 3]
    assert status(fresh)["trajectories"][3]["standing"] == "set aside"
    assert tell(fresh, waiting).repeated


def test_new_learns_from_it_and_those_to_come_alone(fresh: Campaign, waiting: Path, tmp_path: Path) -> None:
    found = tell(fresh, [], changed="new")
    assert found.learned == (4,)
    assert learned(fresh) == [4]
    facts = fresh.state().trained[-1].trained
    assert facts is not None
    assert (facts.logs, facts.models) == ((4,), {})
    assert fresh.events()[-2].fact.aside == (1, 2, 3)
    later = write_changed(tmp_path / "5.csv", fresh, 5, CHANGES["friction has changed"])
    assert tell(fresh, later).learned == (5,)
    old = write_log(tmp_path / "6.csv", random_motion(fresh, 6), 6)
    assert tell(fresh, old).awaits_answer


def test_the_answer_may_come_with_the_log(fresh: Campaign, tmp_path: Path) -> None:
    log = write_changed(tmp_path / "4.csv", fresh, 4, CHANGES["friction has changed"])
    assert tell(fresh, log, changed="new").learned == (4,)
    assert [e.event for e in fresh.events()][-3:] == ["told", "changed", "trained"]


def test_an_answer_to_nothing_and_a_word_that_is_none(fresh: Campaign) -> None:
    with pytest.raises(UsageError, match="no log waits"):
        tell(fresh, [], changed="new")
    with pytest.raises(UsageError, match="no such answer"):
        tell(fresh, [], changed="maybe")


def test_the_command_asks_and_a_script_is_told(
    fresh: Campaign, waiting: Path, tmp_path: Path, capsys: Any
) -> None:
    """By the exit code alone: `etude tell && etude ask` must not go on with a log that was not learned."""
    assert main(["tell", str(fresh.path), str(waiting)]) == 6
    text = capsys.readouterr().out
    (tmp_path / "bad.csv").write_text("no log\n")
    assert main(["tell", str(fresh.path), str(waiting), str(tmp_path / "bad.csv")]) == 6
    assert main(["tell", str(fresh.path), str(tmp_path / "bad.csv")]) == 3
    capsys.readouterr()
    assert "Log 4 is not used for training yet." in text
    assert "--changed forget" in text
    assert main(["tell", str(fresh.path), "--changed", "forget", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["learned"] == []
    assert fresh.state().awaiting_answer == []
    assert main(["tell", str(fresh.path), str(waiting)]) == 0  # answered: it waits no more


@pytest.mark.usefixtures("waiting")
def test_status_begins_with_it_and_does_not_say_go_on(fresh: Campaign, capsys: Any) -> None:
    assert main(["status", str(fresh.path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("RED: log 4: the robot differs from the one")
    assert "--changed new" in lines[0]
    assert not any(line.startswith(("Go on", "Stop")) for line in lines)


def test_a_damaged_model_refuses_no_log(fresh: Campaign, tmp_path: Path) -> None:
    (fresh.model_folder(3) / "model.npz").write_bytes(b"damaged")
    log = write_log(tmp_path / "4.csv", random_motion(fresh, 4), 4)
    with pytest.raises(UsageError, match=r"model\.npz was changed"):
        tell(replace(fresh), log)
    assert [r.number for r in fresh.state().pending] == [4]
