"""The studies of changed robots: what their rows count, how recordings are divided, what the arm changes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from etude.errors import UsageError
from etude.models import ChangeTest
from etude.types import Channel, Log, Samples
from etude_studies.bench_changed import GAIN, larger, others, thirds
from etude_studies.changed_robot import OTHERS, facts_of
from etude_studies.changed_rows import rows_of
from etude_studies.seven_joints import SevenJoints


def run(alarm_s: float | None, named: str = "unknown", largest: float = 1.0) -> dict[str, Any]:
    return {"alarm_s": alarm_s, "named": named, "largest": largest}


def test_rows_count_false_alarms_soon_and_late_ones_and_names_of_the_noticed() -> None:
    cells = [
        {
            "freedom": 4.0,
            "unchanged_0": run(None, largest=3.0),
            "unchanged_1": run(40.0, "load", 12.0),
            "load": run(4.0, "load"),
            "friction": run(21.0, "friction"),
            "offset": run(None),
        },
        {
            "freedom": 4.0,
            "unchanged_0": run(None),
            "unchanged_1": run(None),
            "load": run(20.0, "offset"),
            "friction": run(2.0, "friction"),
            "offset": run(None),
        },
    ]
    rows = {row.metric: row for row in rows_of("arm", cells)}
    assert rows["freedom_arm"].value == 4.0
    assert (rows["false_alarms_arm"].value, rows["largest_unchanged_arm"].value) == (1, 12.0)
    assert rows["false_alarms_arm"].reference == "of 4; 95 %: 0.046 to 0.699"
    noticed = [rows[f"{name}_noticed_arm"].value for name in ("load", "friction", "offset")]
    assert noticed == [1.0, 0.5, 0.0]
    assert (rows["load_seconds_arm"].value, rows["friction_longest_arm"].value) == (12.0, 21.0)
    assert "offset_seconds_arm" not in rows
    named = [rows[f"load_named_{word}_arm"].value for word in ("load", "friction", "offset", "unknown")]
    assert named == [1, 0, 1, 0]
    assert rows["offset_named_unknown_arm"].value == 0


def test_a_cell_keeps_when_other_thresholds_were_passed() -> None:
    facts = facts_of(ChangeTest(np.array([1.0, 6.0, 9.0, 18.0]), 3, 4.0, "load", 0), np.arange(4.0))
    assert (facts["largest"], facts["alarm_s"], facts["named"]) == (18.0, 3.0, "load")
    assert facts["others"] == dict(zip((f"{h:g}" for h in OTHERS), (1.0, 2.0, 3.0, None, None), strict=True))


def recorded(count: int, group: int = 0) -> Samples:
    t = np.arange(count) * 0.1
    channel = Channel("command", ("a",), ("N m",), "command")
    log = Log(t, {"command": channel}, {"command": np.sin(t)[:, None]})
    use = np.ones((count, 1), dtype=bool)
    return Samples(log, np.full(count, group, dtype=np.int64), use, use)


def test_each_third_is_judged_by_the_others_and_nothing_near_it() -> None:
    splits = thirds([recorded(60), recorded(90)], gap_s=0.25)
    assert [[len(test) for test in tests] for _, tests in splits] == [[20, 30]] * 3
    train, tests = splits[1]
    assert sorted(np.unique(train.group)) == [0, 2, 3, 5]
    assert len(train) == 40 + 60 - 2 * 4
    first = train.take(train.group < 3)
    assert np.abs(first.t[:, None] - tests[0].t).min() > 0.25


def test_each_flight_is_judged_by_the_others() -> None:
    splits = others([recorded(10), recorded(20)])
    assert [(len(train), [len(test) for test in tests]) for train, tests in splits] == [
        (20, [10]),
        (10, [20]),
    ]


def test_larger_commands_are_all_that_differs() -> None:
    one = recorded(20)
    np.testing.assert_allclose(larger(one).command, GAIN * one.command)
    np.testing.assert_array_equal(larger(one).t, one.t)


def test_the_arm_of_seven_joints_changes_what_it_says() -> None:
    arm = SevenJoints().changed(sensor_j3=2.0).changed(friction=1.5)
    assert (arm.sensor, arm.friction) == ((0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0), 1.5)
    with pytest.raises(UsageError, match="cannot change its wind"):
        arm.changed(wind=1.0)
