"""The study of the search: gains are what they say, and a finished cell is not run again."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from etude_studies import design_gain
from etude_studies.design_gain import cell, gain_rows


def test_gains_are_differences_with_intervals() -> None:
    cells = [{"value": 3.0 + i, "baseline": 2.5, "evaluations": 10.0, "seconds": 0.5} for i in range(3)]
    rows = {row.metric: row.value for row in gain_rows("arm4", cells)}
    assert rows["design_gain_arm4"] == pytest.approx(1.5)
    assert rows["design_gain_arm4_ci95"] == pytest.approx(4.3026527 / 3**0.5)
    assert rows["design_cpu_arm4"] == 0.5


def test_a_finished_cell_is_read_and_a_new_one_searched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = cell("arm4", 0, tmp_path)
    assert found["value"] >= found["baseline"]
    assert found["evaluations"] > 24
    monkeypatch.setattr(design_gain, "searched", lambda *_: pytest.fail("searched again"))
    assert cell("arm4", 0, tmp_path) == json.loads((tmp_path / "arm4_0000.json").read_bytes())
