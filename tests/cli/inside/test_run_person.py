"""The person at the terminal: who types the word, and whose switch is let go."""

from __future__ import annotations

import io
import os
from pathlib import Path

import pytest

from etude.cli.run import LOOKED_S, TerminalUser


@pytest.mark.parametrize(("typed", "agreed"), [("move\n", True), ("yes\n", False), ("", False)])
def test_the_word_is_typed_in_full(monkeypatch: pytest.MonkeyPatch, typed: str, agreed: bool) -> None:
    said: list[str] = []
    monkeypatch.setattr("sys.stdin", io.StringIO(typed))
    assert TerminalUser(said.append).agrees(["It will move."], "move") is agreed
    assert said[0] == "It will move."


def test_in_a_script_nobody_types(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("move\n"))
    assert not TerminalUser(lambda _: None, asks=False).agrees([], "move")


def test_a_heartbeat_that_stops_is_nobody_at_the_switch(tmp_path: Path) -> None:
    beat = tmp_path / "beat"
    beat.touch()
    person = TerminalUser(lambda _: None, heartbeat=beat)
    assert person.alive()
    os.utime(beat, (1.0, 1.0))
    person.looked -= LOOKED_S
    assert not person.alive()
    beat.touch()
    person.looked -= LOOKED_S
    assert person.alive()
    beat.unlink()
    person.looked -= LOOKED_S
    assert not person.alive()
