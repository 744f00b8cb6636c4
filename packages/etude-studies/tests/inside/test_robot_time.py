"""The benchmark of robot time: entries from outside, blind tests, traps, the leaderboard."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from etude.errors import DataError, UsageError
from etude_studies import robot_time
from etude_studies.robot_time import (
    ETUDE,
    LINEAR,
    EntryResult,
    Lesson,
    entries,
    entry_of,
    leaderboard,
    rows,
    task,
)


def mean_command(lesson: Lesson) -> Any:
    """An entry: it asks for no states, and refuses nothing."""
    level = lesson.samples.command.mean(axis=0)
    return lambda states: np.tile(level, (len(states), 1))


def made_up(entry: str, errors: dict[str, dict[str, float | None]], **other: Any) -> EntryResult:
    told = {"seed": 0, "cpu_s": 1.0, "data": dict.fromkeys(errors, "same"), "traps": {"arm4 sign": True}}
    return EntryResult(entry, errors=errors, **{**told, **other})


def test_an_entry_from_outside_meets_every_robot_and_never_the_commands(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(robot_time, "SIMULATED", ("arm4",))
    monkeypatch.setattr(robot_time, "RECORDED", {"ur10": robot_time.RECORDED["ur10"]})
    asked = []

    def entry(lesson: Lesson) -> Any:
        inside = mean_command(lesson)

        def predict(states: Any) -> Any:
            asked.append({*states.values})
            return inside(states)

        return predict

    monkeypatch.setattr(robot_time, "entry_of", lambda _: entry)
    (found,) = robot_time.run(folder=tmp_path, method="mine:learn")
    assert {*found.errors} == {"arm4", "ur10"}
    assert all(own["30"] is not None and own["30"] > 50.0 for own in found.errors.values())
    assert not any(found.traps.values())
    assert {trap.split()[1] for trap in found.traps} == {*robot_time.TRAPS}
    assert asked
    assert all("command" not in names for names in asked)
    assert "mine:learn" in (tmp_path / "leaderboard.html").read_text(encoding="utf-8")
    assert "mine:learn" in capsys.readouterr().out


def test_another_seed_is_another_blind_test() -> None:
    first, second = (task("arm4", seed)[2].command for seed in (0, 1))
    assert first.shape != second.shape or not np.allclose(first, second)


def test_seconds_count_from_where_the_error_stays_low() -> None:
    own = made_up("a:b", {"arm4": {"3": 9.0, "10": 30.0, "30": 8.0}, "ur10": {"3": None, "10": 25.0}})
    assert own.until("arm4", 10.0) == 30.0
    assert own.until("arm4", 40.0) == 3.0
    assert math.isnan(own.until("ur10", 20.0))
    assert own.until("ur10", 25.0) == 10.0


def test_the_word_is_that_of_paired_robots_and_only_of_the_same_data() -> None:
    names = [f"robot {i}" for i in range(12)]
    spread = np.random.default_rng(0).uniform(0.9, 1.1, 12)
    base = made_up(LINEAR, {n: {"30": 40.0} for n in names})
    good = made_up("good:learn", {n: {"30": 20.0 * s} for n, s in zip(names, spread, strict=True)})
    other = made_up("other:learn", good.errors, data=dict.fromkeys(names, "others"))
    found = {row[0].split()[0]: row for row in rows([good, other, base])}
    assert found["good:learn"][5] == "holds"
    assert float(found["good:learn"][4]) == pytest.approx(0.5, abs=0.05)
    assert found["other:learn"][4:6] == ["", "other data"]
    assert found["good:learn"][6:8] == ["1/1", "0/12"]
    assert "not reached" in leaderboard([good, base])


def test_result_files_are_read_from_several_folders_and_damage_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_bytes(msgspec.json.encode(made_up("a:b", {"arm4": {"3": 5.0}})))
    assert [own.entry for own in entries(tmp_path)] == ["a:b"]
    (tmp_path / "b.json").write_text("{}")
    with pytest.raises(DataError, match=r"b\.json"):
        entries(tmp_path)


def test_what_is_no_function_or_no_answer_is_refused() -> None:
    assert entry_of(LINEAR) is robot_time.linear
    assert entry_of(ETUDE) is robot_time.etude
    with pytest.raises(UsageError, match="no module:function"):
        entry_of("linear")


def test_the_truth_tests_of_etude_refuse_every_trap_of_the_arm() -> None:
    world, _, _ = task("arm4", 0)
    wrong = dict(robot_time.wrong_logs("arm4", 0))
    assert {*wrong} == {*robot_time.TRAPS}
    assert all(robot_time.etude(Lesson("arm4", world, own)) is None for own in wrong.values())
