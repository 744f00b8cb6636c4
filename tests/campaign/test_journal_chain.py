"""The chain of hashes: every line that is deleted, moved or edited is found, by its number."""

from __future__ import annotations

import json
from itertools import combinations
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etude.campaign import Asked, Created, Event, chained, commit, event_to_json, read_events
from etude.errors import UsageError

COUNT = 5


def write(folder: Path, lines: list[str]) -> None:
    (folder / "journal.jsonl").write_bytes("".join(f"{line}\n" for line in lines).encode())


def refusal(folder: Path, lines: list[str]) -> str:
    write(folder, lines)
    with pytest.raises(UsageError) as caught:
        read_events(folder)
    assert caught.value.next_step
    return f"{caught.value.where.rsplit(':', 1)[1]}: {caught.value.fact}"


@pytest.fixture
def lines(tmp_path: Path) -> list[str]:
    """A new journal's."""
    commit(tmp_path, Created(seed=0))
    for number in range(1, COUNT):
        commit(tmp_path, Asked(status="é", value=0.1), number)
    return (tmp_path / "journal.jsonl").read_text().splitlines()


def test_each_line_names_the_one_before(lines: list[str]) -> None:
    import hashlib

    hashes = [hashlib.sha256(text.encode()).hexdigest() for text in ["", *lines]]
    assert [json.loads(line)["previous"] for line in lines] == hashes[:-1]


def test_the_hashes_are_no_facts(tmp_path: Path, lines: list[str]) -> None:
    assert [event.fact for event in read_events(tmp_path)][1] == Asked(status="é", value=0.1)
    assert len(read_events(tmp_path)) == COUNT


@pytest.mark.parametrize("index", range(COUNT - 1))
def test_a_deleted_line(tmp_path: Path, lines: list[str], index: int) -> None:
    found = refusal(tmp_path, lines[:index] + lines[index + 1 :])
    assert found == f"{index + 1}: a line of the journal was deleted, added or moved just before this one"


@pytest.mark.parametrize("index", range(COUNT))
def test_a_doubled_line(tmp_path: Path, lines: list[str], index: int) -> None:
    assert refusal(tmp_path, [*lines[: index + 1], *lines[index:]]).startswith(f"{index + 2}: a line")


@pytest.mark.parametrize(("one", "other"), list(combinations(range(COUNT), 2)))
def test_two_lines_swapped(tmp_path: Path, lines: list[str], one: int, other: int) -> None:
    lines[one], lines[other] = lines[other], lines[one]
    assert refusal(tmp_path, lines).startswith(
        f"{one + 1}: a line of the journal was deleted, added or moved"
    )


@pytest.mark.parametrize("every", [9, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("index", "count"), [(0, COUNT), (2, COUNT), (COUNT - 1, COUNT), (0, 1)])
def test_any_byte_edited(tmp_path: Path, lines: list[str], index: int, count: int, every: int) -> None:
    """The last line and an only one too: the seal is its own."""
    lines, line = lines[:count], lines[index]
    edits = [(place, new) for place, old in enumerate(line) for new in '01a n",' if new != old]
    for place, new in edits[::every]:
        edited = line[:place] + new + line[place + 1 :]
        found = refusal(tmp_path, [*lines[:index], edited, *lines[index + 1 :]])
        assert found.startswith(f"{index + 1}: "), (edited, found)


def test_a_line_stripped_of_its_hashes(tmp_path: Path, lines: list[str]) -> None:
    """What an old program would append, or a hand that knows version 0.1."""
    bare = event_to_json(Event(Asked(status=""), "2026-01-01T00:00:00+00:00", 9))
    assert refusal(tmp_path, [*lines, bare]) == f"{COUNT + 1}: this line of the journal was edited"
    assert refusal(tmp_path, [bare, *lines[1:]]).startswith("1: this journal has no hashes")


def test_an_end_cut_off_is_not_seen(tmp_path: Path, lines: list[str]) -> None:
    """The limit of a chain, stated in its docstring."""
    write(tmp_path, lines[:-2])
    assert len(read_events(tmp_path)) == COUNT - 2


def test_a_torn_last_line_is_dropped_and_the_chain_goes_on(tmp_path: Path, lines: list[str]) -> None:
    path = tmp_path / "journal.jsonl"
    path.write_bytes(path.read_bytes()[:-40])
    assert len(read_events(tmp_path)) == COUNT - 1
    commit(tmp_path, Asked(status=""), 7)
    assert [event.number for event in read_events(tmp_path)] == [None, 1, 2, 3, 7]


@given(st.lists(st.builds(Asked, status=st.text(), learned=st.integers()), max_size=4))
def test_any_facts_chain(tmp_path_factory: pytest.TempPathFactory, facts: list[Asked]) -> None:
    folder = tmp_path_factory.mktemp("any")
    made: list[str] = []
    events = [Event(one, "2026-01-02T03:04:05+00:00", 1, "c") for one in facts]
    for event in events:
        made.append(chained(event_to_json(event), made))
    write(folder, made)
    assert read_events(folder) == events


def test_a_byte_that_is_no_text_is_found(tmp_path: Path, lines: list[str]) -> None:
    path = tmp_path / "journal.jsonl"
    path.write_bytes(path.read_bytes().replace(b'"created"', b'"creat\xe9d"', 1))
    with pytest.raises(UsageError, match=r"was edited \[.*journal\.jsonl:1\]"):
        read_events(tmp_path)


def test_line_endings_that_were_changed_are_named(tmp_path: Path, lines: list[str]) -> None:
    found = refusal(tmp_path, [f"{line}\r" for line in lines])
    assert found == "1: the line endings of the journal were changed, LF to CRLF"


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [("generation", 99, "a newer version of Étude wrote this line"), ("time", "noon", "is not an event")],
)
def test_a_sealed_line_of_another_version_or_time(tmp_path: Path, key: str, value: object, said: str) -> None:
    event = Event(Asked(status=""), "2026-01-02T03:04:05+00:00", 1, "c")
    words = {**json.loads(event_to_json(event)), key: value}
    assert said in refusal(tmp_path, [chained(json.dumps(words), [])])
