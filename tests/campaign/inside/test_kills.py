"""Kills, full disks and two writers: what was committed stays, and running again finishes the work."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
from small_robot import SHORT, make_campaign, stub_learner, write_log

from etude import ask, storage, tell
from etude.campaign import Campaign, create_campaign, open_campaign, stored_trajectory
from etude.campaign.record.journal import damaged_files
from etude.errors import EtudeError, UsageError

HERE = Path(__file__).parent
HELPERS = (HERE, HERE.parent)
"""Folders of what the driver imports."""
CALLS = ("open", "write", "fsync", "replace", "ftruncate")


def run_driver(tmp_path: Path, *arguments: str) -> str:
    places = os.pathsep.join(part for part in (*map(str, HELPERS), os.environ.get("PYTHONPATH")) if part)
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": places}
    command = [sys.executable, str(HERE / "kill_driver.py"), str(tmp_path), *arguments]
    done = subprocess.run(command, check=False, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("kills", [16, pytest.param(200, marks=pytest.mark.slow)])
def test_kills_lose_nothing(tmp_path: Path, kills: int) -> None:
    assert run_driver(tmp_path, str(kills), "1").startswith(f"{kills} kills in ")


class Full:
    """`os` with a disk that is full at the given call and everywhere after."""

    def __init__(self, step: int) -> None:
        self.step, self.seen = step, 0

    def __getattr__(self, name: str) -> Any:
        real = getattr(os, name)
        if name not in CALLS:
            return real

        def call(*args: Any, **kwargs: Any) -> Any:
            self.seen += 1
            if self.seen >= self.step and name in ("write", "fsync"):
                raise OSError(errno.ENOSPC, "No space left on device")
            return real(*args, **kwargs)

        return call


ENOUGH = 0.6
"""Part of a log that has half of the motion; it stands still for a second before."""


def test_a_full_disk_at_every_write(tmp_path: Path) -> None:
    campaign = make_campaign(tmp_path, config=SHORT.replace("duration = 8.0", "duration = 4.0"))
    ask(campaign)
    log = write_log(tmp_path / "run.csv", stored_trajectory(campaign, 1))
    # what answers the proposal and no more: it is read at every step
    rows = log.read_text().splitlines(keepends=True)
    log.write_text("".join(rows[: round(ENOUGH * len(rows))]))
    committed = campaign.events()
    step = 1
    while True:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(storage, "os", Full(step))
            try:
                tell(campaign, log, learner=stub_learner)
                break
            except EtudeError as error:
                assert "No space left on device" in str(error)  # noqa: PT017
        events = campaign.events()
        assert events[: len(committed)] == committed
        assert damaged_files(campaign.path, events) == []
        assert list(campaign.path.rglob(f"{storage.TEMPORARY_PREFIX}*")) == []
        committed = events
        step += 1
    assert step > 10
    assert [e.event for e in campaign.events()] == ["created", "asked", "told", "trained"]


def test_an_interrupted_init_can_be_repeated(tmp_path: Path) -> None:
    for step in range(1, 8):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(storage, "os", Full(step))
            with pytest.raises(EtudeError):
                create_campaign(tmp_path / "lab", "arm4")
        with pytest.raises(UsageError, match=r"no campaign here|not finished"):
            open_campaign(tmp_path / "lab")
    assert create_campaign(tmp_path / "lab", "arm4")[0].state().events == 1


def test_a_torn_line_is_healed_by_the_next_event(campaign: Campaign) -> None:
    ask(campaign)
    with open(campaign.path / "journal.jsonl", "ab") as journal:
        journal.write(b'{"event": "told", "number": 1, "ti')
    assert [e.event for e in campaign.events()] == ["created", "asked"]
    assert ask(campaign, new=True).number == 2
    assert [e.event for e in campaign.events()] == ["created", "asked", "asked"]


def test_two_writers_take_turns(campaign: Campaign, tmp_path: Path) -> None:
    logs = []
    for number in (1, 2):
        ask(campaign, new=True)
        logs.append(write_log(tmp_path / f"{number}.csv", stored_trajectory(campaign, number), number))
    threads = [
        threading.Thread(target=tell, args=(campaign, log), kwargs={"learner": stub_learner})
        for log in logs * 2
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    kinds = [e.event for e in campaign.events()]
    assert sorted(kinds) == ["asked", "asked", "created", "told", "told", "trained", "trained"]
    assert damaged_files(campaign.path, campaign.events()) == []


def test_a_writer_that_does_not_let_go(campaign: Campaign) -> None:
    code = (
        "import sys, time; from pathlib import Path; from etude.storage import writer_lock\n"
        "with writer_lock(Path(sys.argv[1])):\n    print('held', flush=True); time.sleep(60)"
    )
    other = subprocess.Popen(
        [sys.executable, "-c", code, str(campaign.path)], stdout=subprocess.PIPE, text=True
    )
    try:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with pytest.raises(UsageError, match="another process is writing"), campaign.writing(0.1):
            pass
        assert len(campaign.events()) == 1
    finally:
        other.kill()
        other.communicate()
    with campaign.writing(0.0):
        pass
