"""The cheat sheet names every command."""

from __future__ import annotations

from pathlib import Path

from etude.cli.parse import COMMANDS

ROOT = Path(__file__).parents[3]


def test_the_cheat_sheet_names_every_command() -> None:
    table = (ROOT / "docs" / "cheat_sheet.md").read_text(encoding="utf-8")
    assert len(COMMANDS) > 15
    assert [name for name in COMMANDS if f"`{name}" not in table] == []
