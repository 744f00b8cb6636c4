"""Studies of the loop as runs of the thesis's study: which figure goes where, and traces of flights."""

from __future__ import annotations

import numpy as np
import pytest

from etude_studies import flight_loop, online
from etude_studies.thesis import flight_trace_run, other_runs
from etude_studies.thesis.choosing import ledger


def test_passes_changes_and_rules_find_their_places(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def outcomes(cell: online.Cell, rules: dict) -> dict[str, online.Outcome]:
        asked.append((cell, tuple(rules)))
        return {rule: online.Outcome([[k, k + 2.0] for k in range(3)], (0, 0), (0, 0)) for rule in rules}

    monkeypatch.setattr(online, "outcomes_of", outcomes)
    found = {(row.k, row.test, row.model): row.value for row in other_runs.on_line({}, 7, {})}
    assert found[1, "same", "none"] == 1.0
    assert found[3, "payload", "variance"] == 3.0
    assert {cell.seed for cell, _ in asked} == {7}
    assert ("friction", "variance_forgetting") in {(test, model) for _, test, model in found}
    claimed = [part for id in ("C6.4-7", "C7.1-4") for part in ledger().claim(id).parts]
    for part in claimed:
        for source in part.sources:
            assert (part.at[-1], part.test, source.partition(":")[2]) in found


def test_variants_of_the_loop_find_their_places(monkeypatch: pytest.MonkeyPatch) -> None:
    errors = {"pid/calm": 0.5, "gp_voltage_only_4/calm": 0.4, "learned_4/wind": 0.3, "learned_gp_4/calm": 9.0}
    monkeypatch.setattr(flight_loop, "seed_errors", lambda cell, learned_from: errors)
    found = {(row.model, row.test): row.value for row in other_runs.in_the_loop({}, 1, {})}
    assert found == {("pid", "calm"): 0.5, ("gp_voltage_only", "calm"): 0.4, ("learned", "wind"): 0.3}
    (part,) = ledger().claim("C7.1-1").parts
    assert {source.partition(":")[2] for source in part.sources} <= {model for model, _ in found}


def test_a_path_and_a_command_are_traces(monkeypatch: pytest.MonkeyPatch) -> None:
    time, path, command = np.arange(3.0), np.arange(9.0).reshape(3, 3), np.arange(3.0) / 10.0
    told = {"t_path": time, "desired": path, "flown": path + 1.0, "t": time, "actual": command}
    told |= {"mean": command, "deviation": command}
    monkeypatch.setattr(flight_trace_run, "flight_traces", lambda **_: told)
    rows = {(row.k, row.test, row.part, row.measure): row.value for row in flight_trace_run.run({}, 0, {})}
    assert rows[2, "after 2", "y", "flown"] == 8.0
    assert rows[1, "after 5", "thrust", "mean"] == 0.1
    assert rows[2, "after 5", "mean", "t"] == 2.0
