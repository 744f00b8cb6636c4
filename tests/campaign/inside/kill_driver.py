"""Kills writers, each at a random system call, and looks at what is left. Run by test_kills.py.

A process of its own, so that forking is cheap and safe: no threads, everything imported once.
"""

from __future__ import annotations

import os
import random
import signal
import sys
from pathlib import Path
from typing import Any

import numpy as np
from small_robot import make_campaign, stub_learner

from etude import storage
from etude.campaign import Asked, Campaign, abandon, read_events, typical_motions
from etude.campaign.ingest import tell as telling
from etude.campaign.propose import ask as asking
from etude.campaign.record.journal import damaged_files
from etude.types import Log

CONFIG = "[trajectory]\nduration = 5.0\n[data]\ncutoff_hz = 5.0\n"
CALLS = ("open", "write", "fsync", "replace", "ftruncate")
PLACES = ((CALLS, 90), (("write",), 20))
"""Which calls are counted, and at which of them, at most, a session dies; half of them in a write."""


def make_cheap(campaign: Campaign) -> None:
    """Logs come from the proposal itself, and nothing is designed: only the writing is under test."""

    def log_from_name(c: Campaign, path: Path, **_: Any) -> Log:
        t = np.arange(0.0, 5.0, 0.02)
        q, _, qdd = asking.stored_trajectory(c, int(path.stem)).motion(t, 3).orders
        log = Log(t, {}, {}, source=path.name)
        return log.put(c.channel("q"), q).put(c.command, qdd)

    def random_again(c: Campaign, _: Any, rng: np.random.Generator, *rest: Any) -> Any:
        *_, limits, _ = rest
        return typical_motions(c, rng, 1, limits)[0], Asked(status="random")

    telling.read = log_from_name
    telling.repeated = lambda *_: None
    telling.log_bytes = lambda log: log["q"].tobytes()
    type(campaign.kind).samples = lambda *_: None
    asking.proposed = random_again
    asking.newest_model = lambda *_: None


def one_session(campaign: Campaign, inbox: Path, done: int) -> None:
    """What a user types in a session; the index of each committed event is written to `done`."""
    real = storage.append_line

    def acknowledged(path: Path, line: str) -> None:
        real(path, line)
        os.write(done, b".")

    import etude.campaign.record.journal as journal

    journal.append_line = acknowledged
    number = asking.ask(campaign, new=True, go_on=True, speed=50, learner=stub_learner).number
    for proposal in campaign.state().proposals:
        if proposal.number % 7 == 3:
            abandon(campaign, proposal.number, learner=stub_learner)
        elif proposal.number <= number:
            log = inbox / f"{proposal.number}.csv"
            log.write_text(f"log {proposal.number}")
            telling.tell(campaign, log, number=proposal.number, learner=stub_learner)


def die_at(step: int, names: tuple[str, ...], before: bool) -> None:
    """This process dies at the `step`-th of these calls of storage, counted from now, or just `before` it."""
    seen = 0

    def wrap(real: Any) -> Any:
        def call(*args: Any, **kwargs: Any) -> Any:
            nonlocal seen
            seen += 1
            if seen == step and before:
                os.kill(os.getpid(), signal.SIGKILL)
            if seen == step and real is os.write:
                real(args[0], bytes(args[1])[: len(args[1]) // 2])
            elif seen != step:
                return real(*args, **kwargs)
            else:
                real(*args, **kwargs)
            os.kill(os.getpid(), signal.SIGKILL)

        return call

    class Dying:
        def __getattr__(self, name: str) -> Any:
            real = getattr(os, name)
            return wrap(real) if name in names else real

    dying = Dying()
    wrapped = {name: getattr(dying, name) for name in names}
    dying.__dict__.update(wrapped)
    storage.os = dying  # type: ignore[assignment]


def one_campaign(folder: Path, kills: int) -> int:
    """Kills `kills` sessions on one campaign, then lets one finish the work; returns how many it took."""
    campaign = make_campaign(folder, config=CONFIG)
    inbox = folder / "inbox"
    inbox.mkdir()
    make_cheap(campaign)
    killed = sessions = 0
    while killed < kills:
        sessions += 1
        before = read_events(campaign.path)
        read_end, write_end = os.pipe()
        names, most = random.choice(PLACES)  # here, as every child gets a seed of its own
        step, before_it = random.randint(1, most), random.random() < 0.5
        child = os.fork()
        if child == 0:
            die_at(step, names, before_it)
            one_session(campaign, inbox, write_end)
            os._exit(0)
        os.close(write_end)
        _, status = os.waitpid(child, 0)
        with os.fdopen(read_end, "rb") as pipe:
            acknowledged = len(pipe.read())
        killed += os.WIFSIGNALED(status)
        assert os.WIFSIGNALED(status) or status == 0, f"session {sessions} failed: {status}"
        after = read_events(campaign.path)
        assert after[: len(before)] == before, "a committed event was lost"
        assert len(after) - len(before) >= acknowledged, "an acknowledged event was lost"
        assert damaged_files(campaign.path, after) == [], "a committed file is damaged"
    one = os.fork()
    if one == 0:
        one_session(campaign, inbox, os.open(os.devnull, os.O_WRONLY))
        os._exit(0)
    assert os.waitpid(one, 0)[1] == 0
    state = campaign.state()
    assert state.pending == []
    assert state.proposals == []
    assert list(campaign.path.rglob(f"{storage.TEMPORARY_PREFIX}*")) == []
    return sessions


def main(folder: Path, kills: int, seed: int) -> None:
    random.seed(seed)
    sessions = sum(one_campaign(folder / str(i), 20) for i in range(kills // 20))
    sys.stdout.write(f"{kills} kills in {sessions} sessions\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
