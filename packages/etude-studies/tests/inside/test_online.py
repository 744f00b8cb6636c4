"""The study and the bench rows of learning on line, at a size that takes no time."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from etude.errors import UsageError
from etude_online import OnlineConfig
from etude_studies import online, online_rows
from etude_studies.online import Cell, Outcome
from etude_studies.world import World

FEW = {"none": None, "variance": OnlineConfig("variance", size=40)}


def outcome(*means: float) -> Outcome:
    return Outcome([[mean, mean] for mean in means], (10.0, 20.0), (30.0, 90.0))


@pytest.fixture
def quick_world(monkeypatch) -> None:
    monkeypatch.setattr(online, "PASS_S", 10.0)
    monkeypatch.setattr(online, "CHANGE_S", 10.0)
    monkeypatch.setattr(online, "PASSES", 2)
    monkeypatch.setattr(online, "PLACES", {("arm4", "same"): FEW, ("arm4", "friction"): FEW})


def test_a_cell_runs_every_rule_is_kept_and_not_run_again(quick_world, monkeypatch, tmp_path: Path) -> None:
    cell = Cell("arm4", "friction", 3)
    found = online.run_cell(cell, tmp_path)
    assert list(found) == ["none", "variance"]
    assert np.shape(found["none"].errors) == (2, 4)
    assert found["variance"].update_us[1] >= found["variance"].update_us[0] > 0.0
    monkeypatch.setattr(online, "outcomes_of", lambda *_: pytest.fail("run again"))
    again = online.run_cell(cell, tmp_path)
    assert again == found


def test_rows_are_means_beside_those_without_updates_and_paired_gains(monkeypatch) -> None:
    monkeypatch.setattr(online, "PLACES", {("arm4", "same"): FEW})
    outcomes = {
        Cell("arm4", "same", 0): {"none": outcome(1.0, 1.0, 2.0), "variance": outcome(1.0, 0.5, 0.4)},
        Cell("arm4", "same", 1): {"none": outcome(1.0, 1.0, 4.0), "variance": outcome(1.0, 0.5, 0.6)},
    }
    rows = {row.metric: row for row in online.study_rows(outcomes)}
    third = rows["arm4_same_variance_pass3"]
    assert (third.value, third.reference_value, third.unit) == (pytest.approx(0.5), 3.0, "deg")
    assert rows["arm4_same_variance_gain"].value == pytest.approx(2.5)
    assert rows["arm4_same_variance_gain_ci95"].value > 0.0
    assert "arm4_same_none_gain" not in rows
    assert (rows["update_us_variance"].value, rows["update_us_variance"].reference_value) == (30.0, 90.0)


def test_every_place_is_a_robot_that_can_change_so() -> None:
    for robot, change in online.PLACES:
        arm = World.of(robot).robot
        changed = arm.changed(**online.CHANGES[change])
        assert (changed.parameters == arm.parameters) == (change == "same")


def test_one_seed_has_no_interval() -> None:
    with pytest.raises(UsageError, match="2 seeds"):
        online.run(json=True, seed=0, seeds=1, folder=Path("nowhere"))


def test_the_command_prints_the_rows(monkeypatch, capsys, tmp_path: Path) -> None:
    monkeypatch.setattr(online, "PLACES", {("arm4", "same"): FEW})
    made = {"none": outcome(1.0, 1.0, 2.0), "variance": outcome(1.0, 0.5, 0.4)}
    monkeypatch.setattr(online, "_run_all", lambda cells, folder: ((cell, made) for cell in cells))
    online.run(json=True, seed=5, seeds=2, folder=tmp_path)
    found = json.loads(capsys.readouterr().out)
    assert found["command"] == "etude study online --seed 5 --seeds 2"
    assert {"arm4_same_variance_pass3", "arm4_same_none_pass1"} <= {row["metric"] for row in found["rows"]}


def test_bench_rows_are_the_third_passes(monkeypatch) -> None:
    seen = []

    def outcomes(cell: Cell, rules: dict) -> dict[str, Outcome]:
        seen.append(cell)
        return {name: outcome(1.0, 1.0, float(k)) for k, name in enumerate(rules, start=1)}

    monkeypatch.setattr(online_rows, "outcomes_of", outcomes)
    rows = {row.metric: row for row in online_rows.online_rows(np.random.default_rng(0))}
    assert (rows["online_pass3_deg"].value, rows["online_pass3_deg"].reference_value) == (2.0, 1.0)
    assert {f"online_pass3_{rule}_deg" for rule in ("error", "ssgp", "sogp")} <= set(rows)
    assert len({cell.seed for cell in seen}) == online_rows.SEEDS >= 6
    seen.clear()
    online_rows.online_rows(np.random.default_rng(0), quick=True)
    assert len(seen) == online_rows.QUICK_SEEDS
