"""The journal and its replay: nothing committed is lost, nothing uncommitted is believed."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etude.campaign.record.journal import Event, commit, damaged_files, read_events
from etude.campaign.record.state import State, replay
from etude.errors import UsageError


def test_an_event_round_trips(tmp_path: Path) -> None:
    file = tmp_path / "runs" / "0001.parquet"
    file.parent.mkdir()
    file.write_bytes(b"data")
    live = commit(tmp_path, "told", 1, "abc", [file], sha256="f00", note="é\nnew line")
    assert read_events(tmp_path) == [live]
    assert list(live.files) == ["runs/0001.parquet"]


def test_no_journal_is_no_events(tmp_path: Path) -> None:
    assert read_events(tmp_path) == []
    assert replay([]) == State()


def test_not_a_number_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        commit(tmp_path, "trained", 1, "", [], nmse=float("nan"))
    assert read_events(tmp_path) == []


@pytest.mark.parametrize("line", ["{", "[]", "3", '{"event": "told"}', "\x00\x01"])
def test_an_edited_journal_names_the_line(tmp_path: Path, line: str) -> None:
    commit(tmp_path, "created", None, "", [], seed=0)
    with open(tmp_path / "journal.jsonl", "a") as file:
        file.write(line + "\n")
    with pytest.raises(UsageError, match=r"journal\.jsonl:2"):
        read_events(tmp_path)


def test_an_unknown_event_is_named(tmp_path: Path) -> None:
    commit(tmp_path, "created", None, "", [], seed=0)
    path = tmp_path / "journal.jsonl"
    path.write_text(path.read_text().replace("created", "danced"))
    with pytest.raises(UsageError, match="danced"):
        read_events(tmp_path)


def test_a_changed_file_is_noticed(tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        (tmp_path / name).write_text(name)
    commit(tmp_path, "created", None, "", [tmp_path / n for n in "abc"], seed=0)
    (tmp_path / "a").unlink()
    (tmp_path / "b").write_text("other")
    assert damaged_files(tmp_path, read_events(tmp_path)) == [
        "a is missing",
        "b was changed after it was committed",
    ]


def fact(event: str, number: int | None = None, **facts: object) -> Event:
    return Event(event, "2026-01-01T00:00:00+00:00", number, "", {}, facts)


def test_one_round_through_its_life() -> None:
    events = [fact("created", seed=7), fact("asked", 1, seed=3)]
    assert [r.number for r in replay(events).proposals] == [1]
    events.append(fact("told", 1, sha256="a"))
    state = replay(events)
    assert state.seed == 7
    assert (state.proposals, [r.number for r in state.pending]) == ([], [1])
    assert state.round_of_log("a") == state.rounds[1]
    assert state.round_of_log("b") is None
    events.append(fact("trained", 1, models={}))
    assert replay(events).pending == []
    assert replay(events).next_number == 2


def test_a_late_log_revives_an_abandoned_round() -> None:
    events = [fact("asked", 1, seed=3), fact("abandoned", 1)]
    assert replay(events).proposals == []
    assert [r.number for r in replay([*events, fact("told", 1, sha256="a")]).told] == [1]


def test_order_of_learning_is_the_order_of_the_journal() -> None:
    events = [fact(e, n, sha256=str(n)) for n in (3, 1, 2) for e in ("told", "trained")]
    assert [r.number for r in replay(events).trained] == [3, 1, 2]
    assert [r.number for r in replay(events).told] == [1, 2, 3]


@given(st.lists(st.tuples(st.sampled_from(["asked", "told", "trained", "abandoned"]), st.integers(1, 4))))
def test_replay_in_pieces_is_replay_at_once(steps: list[tuple[str, int]]) -> None:
    events = [fact(event, number, sha256="x") for event, number in steps]
    state = replay(events)
    assert state.events == len(events)
    assert set(state.rounds) == {number for _, number in steps}
    assert all(not r.open for r in state.told)
