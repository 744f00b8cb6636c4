"""Rows of the study of changed robots: shares with their intervals, seconds, and what was taken for what."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, get_args

import numpy as np

from etude.models import Cause
from etude_studies.rows import Row
from etude_studies.thesis.statistics import wilson

SOON = 20.0
"""s of motion within which a change should be noticed."""
CHANGES = ("load", "friction", "offset")


def rows_of(robot: str, cells: Sequence[dict[str, Any]]) -> list[Row]:
    """Of one robot's cells, or of all."""
    unchanged = [c[name] for c in cells for name in c if name.startswith("unchanged")]
    alarms = sum(facts["alarm_s"] is not None for facts in unchanged)
    rows = [
        Row(f"freedom_{robot}", float(np.median([c["freedom"] for c in cells])), "1", "median, of the tails"),
        Row(
            f"false_alarms_{robot}", alarms, "1", f"of {len(unchanged)}; {_interval(alarms, len(unchanged))}"
        ),
        Row(f"largest_unchanged_{robot}", max(facts["largest"] for facts in unchanged), "nats"),
    ]
    for name in CHANGES:
        rows += _noticed(robot, name, [c[name] for c in cells])
    return rows


def _noticed(robot: str, name: str, runs: Sequence[dict[str, Any]]) -> list[Row]:
    seconds = [float("inf") if facts["alarm_s"] is None else facts["alarm_s"] for facts in runs]
    soon = sum(s <= SOON for s in seconds)
    what = f"within {SOON:g} s, of {len(runs)}; {_interval(soon, len(runs))}"
    rows = [Row(f"{name}_noticed_{robot}", soon / len(runs), "1", what)]
    if np.isfinite(seconds).any():
        rows.append(Row(f"{name}_seconds_{robot}", float(np.median(seconds)), "s", "median"))
        rows.append(Row(f"{name}_longest_{robot}", max(s for s in seconds if np.isfinite(s)), "s"))
    named = [facts["named"] for facts in runs if facts["alarm_s"] is not None]
    return rows + [
        Row(f"{name}_named_{word}_{robot}", named.count(word), "1", f"of {len(named)} noticed")
        for word in get_args(Cause)
    ]


def _interval(wins: int, n: int) -> str:
    low, high = wilson(wins, n)
    return f"95 %: {low:.3f} to {high:.3f}"
