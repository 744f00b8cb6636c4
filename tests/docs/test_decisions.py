"""Each decision record says its status, its date and what superseded it, and the index says the same."""

from __future__ import annotations

import re
from datetime import date
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "docs" / "decisions"
RECORDS = sorted(FOLDER.glob("[0-9]*.md"))
HEAD = re.compile(
    r"^# (?P<number>\d{4}) .+\n\n"
    r"\*\*Status:\*\* (?P<status>accepted|superseded|accepted, superseded in part)"
    r" · \*\*Date:\*\* (?P<date>\d{4}-\d\d-\d\d)"
    r" · \*\*Superseded by:\*\* (?P<by>.+)\n"
)
LINK = re.compile(r"\[(\d{4})\]\((\d{4}-[\w-]+\.md)\)")


def test_there_are_records() -> None:
    assert len(RECORDS) >= 46


@pytest.mark.parametrize("record", RECORDS, ids=lambda path: path.stem)
def test_a_record_begins_with_its_status(record: Path) -> None:
    head = HEAD.match(record.read_text(encoding="utf-8"))
    assert head, "status, date and 'Superseded by' stand below the title"
    assert head["number"] == record.name[:4]
    assert date.fromisoformat(head["date"]) >= date(2026, 11, 21)
    if head["status"] == "accepted":
        assert head["by"] == "nothing"
    else:
        number, name = LINK.match(head["by"]).groups()  # type: ignore[union-attr]
        assert name.startswith(number)
        assert number > record.name[:4], "a later record supersedes an earlier one"
        assert (FOLDER / name).exists()


@pytest.mark.parametrize("record", RECORDS, ids=lambda path: path.stem)
def test_the_index_says_the_same(record: Path) -> None:
    head = HEAD.match(record.read_text(encoding="utf-8"))
    index = (FOLDER / "README.md").read_text(encoding="utf-8")
    row = re.search(rf"^\| \[{record.name[:4]}\]\({record.name}\) \| .+$", index, re.MULTILINE)
    assert row, "the record has a row in docs/decisions/README.md"
    assert head
    cells = row[0].strip("| ").split(" | ")
    assert cells[3] == head["date"]
    assert cells[2].startswith(head["status"])
    assert [own for own, _ in LINK.findall(cells[2])] == [own for own, _ in LINK.findall(head["by"])][:1]


GONE = (
    "protocols.py",
    "`contracts",
    "robots/arm",
    "robots/quadrotor",
    "models/online",
    "models/physics",
    "deploy.runtime",
)


@pytest.mark.parametrize("record", RECORDS, ids=lambda path: path.stem)
def test_a_record_of_a_gone_room_says_where_it_is_now(record: Path) -> None:
    text = record.read_text(encoding="utf-8")
    if any(name in text for name in GONE):
        assert "\n**Today:** " in text
