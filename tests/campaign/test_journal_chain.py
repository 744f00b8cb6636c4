"""The chain of hashes: every line that is deleted, moved or edited is found, by its number."""

from __future__ import annotations

import json
import shutil
from itertools import combinations
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etude.campaign.record.journal import Event, chained, commit, read_events
from etude.errors import UsageError

OLD = Path(__file__).parent / "journal_0_1.jsonl"
"""The journal of a campaign that version 0.1 made."""
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
    commit(tmp_path, "created", None, "c", [], seed=0)
    for number in range(1, COUNT):
        commit(tmp_path, "asked", number, "c", [], note="é", value=0.1)
    return (tmp_path / "journal.jsonl").read_text().splitlines()


def test_each_line_names_the_one_before(lines: list[str]) -> None:
    import hashlib

    hashes = [hashlib.sha256(text.encode()).hexdigest() for text in ["", *lines]]
    assert [json.loads(line)["previous"] for line in lines] == hashes[:-1]


def test_the_hashes_are_no_facts(tmp_path: Path, lines: list[str]) -> None:
    assert [event.facts for event in read_events(tmp_path)][1] == {"note": "é", "value": 0.1}
    for name in ("previous", "seal"):
        with pytest.raises(ValueError, match=name):
            commit(tmp_path, "asked", 9, "c", [], **{name: "x"})
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


@pytest.mark.parametrize(("index", "count"), [(0, COUNT), (2, COUNT), (COUNT - 1, COUNT), (0, 1)])
def test_any_byte_edited(tmp_path: Path, lines: list[str], index: int, count: int) -> None:
    """The last line and an only one too: the seal is its own."""
    lines, line = lines[:count], lines[index]
    for place, old in enumerate(line):
        for new in {"0", "1", "a", " ", "n", '"', ","} - {old}:
            edited = line[:place] + new + line[place + 1 :]
            found = refusal(tmp_path, [*lines[:index], edited, *lines[index + 1 :]])
            assert found.startswith(f"{index + 1}: "), (edited, found)


def test_a_line_stripped_of_its_hashes(tmp_path: Path, lines: list[str]) -> None:
    """What an old program would append, or a hand that knows version 0.1."""
    bare = Event("asked", "2026-01-01T00:00:00+00:00", 9, "c").to_json()
    assert refusal(tmp_path, [*lines, bare]) == f"{COUNT + 1}: this line of the journal was edited"
    assert refusal(tmp_path, [bare, *lines[1:]]).startswith("1: the journal was changed in its first 1 lines")


def test_an_end_cut_off_is_not_seen(tmp_path: Path, lines: list[str]) -> None:
    """The limit of a chain, stated in its docstring."""
    write(tmp_path, lines[:-2])
    assert len(read_events(tmp_path)) == COUNT - 2


def test_a_torn_last_line_is_dropped_and_the_chain_goes_on(tmp_path: Path, lines: list[str]) -> None:
    path = tmp_path / "journal.jsonl"
    path.write_bytes(path.read_bytes()[:-40])
    assert len(read_events(tmp_path)) == COUNT - 1
    commit(tmp_path, "asked", 7, "c", [])
    assert [event.number for event in read_events(tmp_path)] == [None, 1, 2, 3, 7]


@given(st.lists(st.dictionaries(st.text(), st.integers() | st.text(), max_size=3), max_size=4))
def test_any_facts_chain(tmp_path_factory: pytest.TempPathFactory, facts: list[dict[str, object]]) -> None:
    folder = tmp_path_factory.mktemp("any")
    made: list[str] = []
    events = [Event("asked", "t", 1, "c", {}, {f"fact {k}": v for k, v in row.items()}) for row in facts]
    for event in events:
        made.append(chained(event.to_json(), made))
    write(folder, made)
    assert read_events(folder) == events


class TestVersion01:
    @pytest.fixture
    def old(self, tmp_path: Path) -> list[str]:
        shutil.copy(OLD, tmp_path / "journal.jsonl")
        return OLD.read_text().splitlines()

    def test_it_is_read(self, tmp_path: Path, old: list[str]) -> None:
        events = read_events(tmp_path)
        assert [event.event for event in events] == ["created", *["evaluated"] * 4, "asked", "told"]
        assert events[-1].facts["rows"] == 1000

    def test_a_byte_that_is_no_text_is_found(self, tmp_path: Path, old: list[str]) -> None:
        path = tmp_path / "journal.jsonl"
        path.write_bytes(path.read_bytes().replace(b'"arm4"', b'"arm\xe9"', 1))
        with pytest.raises(UsageError, match=r"not an event \[.*journal\.jsonl:1\]"):
            read_events(tmp_path)

    def test_the_chain_begins_at_the_next_line(self, tmp_path: Path, old: list[str]) -> None:
        before = read_events(tmp_path)
        for number in (2, 3):
            commit(tmp_path, "asked", number, "c", [])
        assert read_events(tmp_path)[: len(before)] == before
        lines = (tmp_path / "journal.jsonl").read_text().splitlines()
        assert lines[: len(old)] == old
        assert ['"previous"' in line for line in lines] == [False] * len(old) + [True, True]
        assert refusal(tmp_path, [*lines[:-2], lines[-1]]).startswith("1: ")

    def test_from_then_on_the_old_part_is_covered(self, tmp_path: Path, old: list[str]) -> None:
        commit(tmp_path, "asked", 2, "c", [])
        (new,) = (tmp_path / "journal.jsonl").read_text().splitlines()[len(old) :]
        words = f"1: the journal was changed in its first {len(old)} lines, of version 0.1"
        assert refusal(tmp_path, [old[1], old[0], *old[2:], new]) == words
        assert refusal(tmp_path, [old[0].replace("arm4", "arm5"), *old[1:], new]) == words
        assert refusal(tmp_path, [*old[:-1], old[-1].replace("1000", "1001"), new]) == words
        assert refusal(tmp_path, [*old[1:], new]).startswith("1: ")
        assert refusal(tmp_path, [new]).startswith("1: ")
        write(tmp_path, [*old, new])
        assert len(read_events(tmp_path)) == len(old) + 1
