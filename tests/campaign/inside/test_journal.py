"""The journal and its replay: nothing committed is lost, nothing uncommitted is believed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etude.campaign import FORMAT, Created, Event, State, Trained, chained, commit, read_events, replay
from etude.campaign.record.events import Ingested
from etude.campaign.record.journal import damaged_files
from etude.errors import UsageError
from journal_facts import fact

LINE = {
    "event": "created",
    "time": "",
    "number": None,
    "config_sha256": "",
    "files": {},
    "seed": 0,
}


def write(folder: Path, words: dict[str, object]) -> None:
    (folder / "journal.jsonl").write_text(f"{chained(json.dumps(words), [])}\n")


def test_an_event_round_trips(tmp_path: Path) -> None:
    file = tmp_path / "runs" / "0001.parquet"
    file.parent.mkdir()
    file.write_bytes(b"data")
    told = Ingested(sha256="f00", source="é\nnew line")
    live = commit(tmp_path, told, 1, [file], config_sha256="abc")
    assert read_events(tmp_path) == [live]
    assert list(live.files) == ["runs/0001.parquet"]


def test_no_journal_is_no_events(tmp_path: Path) -> None:
    assert read_events(tmp_path) == []
    assert replay([]) == State()


def test_not_a_number_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        commit(tmp_path, Trained(chosen="gp", moved=float("nan")), 1)
    assert read_events(tmp_path) == []


@pytest.mark.parametrize("line", ["{", "[]", "3", '{"event": "told"}', "\x00\x01"])
def test_an_edited_journal_names_the_line(tmp_path: Path, line: str) -> None:
    commit(tmp_path, Created(seed=0))
    with open(tmp_path / "journal.jsonl", "a") as file:
        file.write(line + "\n")
    with pytest.raises(UsageError, match=r"journal\.jsonl:2"):
        read_events(tmp_path)


def test_an_unknown_event_is_named(tmp_path: Path) -> None:
    write(tmp_path, {**LINE, "event": "danced"})
    with pytest.raises(UsageError, match="danced"):
        read_events(tmp_path)


def test_a_newer_format_is_refused(tmp_path: Path) -> None:
    write(tmp_path, {**LINE, "version": FORMAT})
    assert len(read_events(tmp_path)) == 1
    write(tmp_path, {**LINE, "version": FORMAT + 1})
    with pytest.raises(UsageError, match="a newer version") as problem:
        read_events(tmp_path)
    assert "later" in problem.value.next_step


def test_a_journal_without_hashes_is_refused(tmp_path: Path) -> None:
    (tmp_path / "journal.jsonl").write_text(f"{json.dumps(LINE)}\n")
    with pytest.raises(UsageError, match="no hashes: an early version") as problem:
        read_events(tmp_path)
    assert "etude init" in problem.value.next_step


@pytest.mark.parametrize(
    "change",
    [{"seed": "0"}, {"seed": 0.5}, {"files": {"a": 1}}, {"number": "1"}, {"time": None}, {"axes": "xy"}],
)
def test_a_fact_of_another_type_is_no_event(tmp_path: Path, change: dict[str, object]) -> None:
    write(tmp_path, {**LINE, **change})
    with pytest.raises(UsageError, match="is not an event"):
        read_events(tmp_path)


@pytest.mark.parametrize("lacking", ["seed", "time", "number", "files"])
def test_a_fact_that_lacks_a_field_is_no_event(tmp_path: Path, lacking: str) -> None:
    write(tmp_path, {name: value for name, value in LINE.items() if name != lacking})
    with pytest.raises(UsageError, match="is not an event"):
        read_events(tmp_path)


def test_a_changed_file_is_noticed(tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        (tmp_path / name).write_text(name)
    commit(tmp_path, Created(seed=0), None, [tmp_path / n for n in "abc"])
    (tmp_path / "a").unlink()
    (tmp_path / "b").write_text("other")
    assert [one.sentence for one in damaged_files(tmp_path, read_events(tmp_path))] == [
        "a is missing",
        "b was changed after Étude stored it",
    ]


NEEDED = {
    "created": {"seed": 7},
    "asked": {"status": ""},
    "told": {"sha256": "a"},
    "trained": {"chosen": "gp"},
}


def event(name: str, number: int | None = None, **facts: object) -> Event:
    return Event(fact(name, **{**NEEDED.get(name, {}), **facts}), "2026-01-01T00:00:00+00:00", number)


def test_one_round_through_its_life() -> None:
    events = [event("created"), event("asked", 1)]
    assert [r.number for r in replay(events).proposals] == [1]
    events.append(event("told", 1))
    state = replay(events)
    assert state.seed == 7
    assert (state.proposals, [r.number for r in state.pending]) == ([], [1])
    assert state.round_of_log("a") == state.rounds[1]
    assert state.round_of_log("b") is None
    events.append(event("trained", 1))
    assert replay(events).pending == []
    assert replay(events).next_number == 2


def test_a_late_log_revives_an_abandoned_round() -> None:
    events = [event("asked", 1), event("abandoned", 1)]
    assert replay(events).proposals == []
    assert [r.number for r in replay([*events, event("told", 1)]).ingested] == [1]


def test_order_of_learning_is_the_order_of_the_journal() -> None:
    events = [event(e, n) for n in (3, 1, 2) for e in ("told", "trained")]
    assert [r.number for r in replay(events).trained] == [3, 1, 2]
    assert [r.number for r in replay(events).ingested] == [1, 2, 3]


@given(st.lists(st.tuples(st.sampled_from(["asked", "told", "trained", "abandoned"]), st.integers(1, 4))))
def test_replay_in_pieces_is_replay_at_once(steps: list[tuple[str, int]]) -> None:
    events = [event(name, number) for name, number in steps]
    state = replay(events)
    assert state.events == len(events)
    assert set(state.rounds) == {number for _, number in steps}
    assert all(not r.open for r in state.ingested)
