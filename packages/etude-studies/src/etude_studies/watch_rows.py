"""Rows of the study of watching: false alarms, what was noticed and named, and how soon it is over."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from etude.models import SENSOR
from etude_studies.broken_sensors import FAULTS
from etude_studies.changed_rows import SOON
from etude_studies.rows import Row
from etude_studies.thesis.statistics import wilson

KINDS = {"load": "payload", "friction": "friction"} | dict.fromkeys(SENSOR, "sensor")
CHANGES = ("payload", "friction", "sensor")
WAYS = ("frozen", "online", "forgetting", "batch_20", "batch_60", "batch_120")
Cells = Sequence[Mapping[str, Any]]


def rows_of(cells: Mapping[str, Cells], several: Cells, recovery: Cells) -> list[Row]:
    """Of each robot, and of all."""
    every = {**cells, "all": [c for robot_cells in cells.values() for c in robot_cells]}
    rows = [row for robot, robot_cells in every.items() for row in _robot(robot, robot_cells)]
    return [*rows, *_faults(every["all"]), *_manners(several), *_recovery(recovery)]


def _robot(robot: str, cells: Cells) -> list[Row]:
    same = [c[name] for c in cells for name in c if name.startswith("unchanged")]
    alarms = sum(facts["alarm_s"] is not None for facts in same)
    rows = [
        Row(f"false_alarms_{robot}", alarms, "1", f"of {len(same)}; {_interval(alarms, len(same))}"),
        Row(f"largest_unchanged_{robot}", max(facts["largest"] for facts in same), "nats"),
    ]
    totals = {"right": 0, "unknown": 0, "wrong": 0, "not noticed": 0}
    for change in CHANGES:
        outcomes = [_outcome(change, c[change]) for c in cells]
        soon = sum((c[change]["alarm_s"] or np.inf) <= SOON for c in cells)
        rows.append(Row(f"{change}_soon_{robot}", soon, "1", f"within {SOON:g} s, {_of(soon, len(cells))}"))
        for word in totals:
            totals[word] += outcomes.count(word)
            rows.append(
                Row(
                    f"{change}_{word.replace(' ', '_')}_{robot}",
                    outcomes.count(word),
                    "1",
                    f"of {len(cells)}",
                )
            )
    count = len(CHANGES) * len(cells)
    rows += [
        Row(f"changes_{word.replace(' ', '_')}_{robot}", n, "1", _of(n, count)) for word, n in totals.items()
    ]
    return rows


def _manners(cells: Cells) -> list[Row]:
    """How often a drift was told from a change that came at once."""
    rows = []
    for name, right in (("growing", "little by little"), ("sudden", "at once")):
        wins = sum(c[name] == right for c in cells)
        rows.append(Row(f"{name}_told", wins, "1", _of(wins, len(cells))))
    return rows


def _outcome(change: str, facts: Mapping[str, Any]) -> str:
    if facts["alarm_s"] is None:
        return "not noticed"
    named = KINDS.get(facts["named"], "unknown")
    return "unknown" if named == "unknown" else "right" if named == change else "wrong"


def _faults(cells: Cells) -> list[Row]:
    """Of each kind of broken sensor, how often it was said to be one."""
    rows = []
    for fault in FAULTS:
        selected = [c["sensor"] for c in cells if c["sensor"]["fault"] == fault]
        wins = sum(_outcome("sensor", facts) == "right" for facts in selected)
        rows.append(Row(f"sensor_{fault}_right", wins, "1", _of(wins, len(selected)) if selected else "of 0"))
    return rows


def _recovery(cells: Cells) -> list[Row]:
    """What the error is over that before the change, at once and at the end; and seconds until it is back."""
    rows = []
    for robot, change in dict.fromkeys((c["robot"], c["change"]) for c in cells):
        selected = [c for c in cells if (c["robot"], c["change"]) == (robot, change)]
        name = f"{robot}_{change}"
        rows.append(_middle(f"error_before_{name}", [c["before_deg"] for c in selected], "deg"))
        rows.append(_middle(f"error_at_once_{name}", [c["at_once"] for c in selected]))
        for variant in WAYS:
            seconds = [np.inf if c[variant]["seconds"] is None else c[variant]["seconds"] for c in selected]
            back = int(sum(np.isfinite(seconds)))
            sentence = f"median; {back} of {len(selected)} came back"
            rows.append(Row(f"back_{variant}_{name}", float(np.median(seconds)), "s", sentence))
            rows.append(_middle(f"ratio_{variant}_{name}", [c[variant]["ratio"] for c in selected]))
    return rows


def _middle(metric: str, values: Sequence[float], unit: str = "1") -> Row:
    """The median, and the least and most in words."""
    sentence = f"median; {min(values):.3g} .. {max(values):.3g}"
    return Row(metric, float(np.median(values)), unit, sentence)


def _of(wins: int, n: int) -> str:
    return f"of {n}; {_interval(wins, n)}"


def _interval(wins: int, n: int) -> str:
    low, high = wilson(wins, n)
    return f"95 %: {low:.3f} to {high:.3f}"
