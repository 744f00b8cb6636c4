"""Faults on the wire: what they do to rows, that a cell goes on where it was stopped, and a small one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from etude.models import ModelConfig
from etude_studies import online_faults
from etude_studies.faults import KINDS, NEVER, WIRES, Fault, FaultyWire, drawn
from etude_studies.online_faults import Place, Stage, compared, faults_of, run_cell, stage, study_rows

LIMIT = np.array([200.0, 200.0])


class Heard:
    """Keeps what it is shown."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, dict[str, np.ndarray]]] = []

    def planned(self, motion: object) -> None:
        return None

    def command(self, t: float, row: object) -> tuple[np.ndarray, np.ndarray]:
        return np.array([100.0, -200.0]), np.zeros(2)

    def observe(self, t: float, row: dict[str, np.ndarray]) -> None:
        self.rows.append((t, row))


def heard(kind: str, size: float = 0.5) -> tuple[list[tuple[float, dict[str, np.ndarray]]], FaultyWire]:
    """400 rows of which the middle two seconds are faulty."""
    wire = FaultyWire(Heard(), Fault(kind, 1.0, 3.0, 1, size, 7), "q", LIMIT)
    for k in range(400):
        t = k / 100
        wire.observe(t, {"q": np.array([t, 2 * t]), "command": np.array([10.0 * t, 50.0 + t])})
    return wire.own.rows, wire


@pytest.mark.parametrize("kind", WIRES)
def test_a_fault_changes_what_is_shown_while_it_acts_and_nothing_else(kind: str) -> None:
    rows, _ = heard(kind)
    wrong = []
    for k, (t, row) in enumerate(rows):
        own = k / 100
        right = {"q": np.array([own, 2 * own]), "command": np.array([10.0 * own, 50.0 + own])}
        same = t == k / 100 and all(np.array_equal(row[name], right[name]) for name in right)
        wrong += [] if same else [k]
    assert wrong
    assert min(wrong) >= 100
    assert max(wrong) < 300


def test_faults_are_what_they_are_called() -> None:
    np.testing.assert_array_equal(heard("sign")[0][150][1]["command"], [-15.0, -51.5])
    np.testing.assert_array_equal(heard("sign_of_one")[0][150][1]["command"], [15.0, -51.5])
    assert heard("stuck")[0][290][1]["command"][1] == 51.0
    assert heard("delay")[0][200][1]["command"][1] == pytest.approx(52.0 - 0.27)
    assert heard("clock_back")[0][200][0] == pytest.approx(2.0 - 100.0)
    assert {t for t, _ in heard("clock_stuck")[0][100:300]} == {1.0}
    assert np.isnan([row["q"] for _, row in heard("nan")[0]]).any()
    assert max(np.abs(row["command"]).max() for _, row in heard("spikes")[0]) > 200.0
    wire = heard("saturated_drive")[1]
    np.testing.assert_allclose(wire.command(2.0, {})[0], [0.175 * 200.0, -0.175 * 200.0])
    np.testing.assert_array_equal(wire.command(0.5, {})[0], [100.0, -200.0])


def test_a_fault_is_drawn_by_its_cell_and_kind_alone() -> None:
    place = Place("arm4", "gp", draws=2)
    every, few = dict(faults_of(place, 3)), dict(faults_of(place, 3, ("nan",)))
    assert len(every) == 1 + 2 * len(KINDS)
    assert list(few) == ["clean", "nan_0", "nan_1"]
    assert few["nan_1"] == every["nan_1"] != dict(faults_of(place, 4))["nan_1"]
    ends = [drawn("sign", 4, np.random.default_rng(k)).end for k in range(200)]
    assert 0.15 < np.mean([end == NEVER for end in ends]) < 0.35


@pytest.fixture(scope="module")
def small() -> Stage:
    with pytest.MonkeyPatch.context() as patch:
        config = ModelConfig(rung="gp", kernel="ard_se", points=60, fit_points=60, steps=5, calibrate=False)
        world = online_faults.world_of("arm4")
        patch.setattr(
            online_faults, "world_of", lambda _: replace(world, config=replace(world.config, model=config))
        )
        patch.setattr(online_faults, "PASS_S", 15.0)
        patch.setattr(online_faults, "LENGTH_S", 12.0)
        yield stage(Place("arm4", "gp"), 12)


@pytest.mark.parametrize(
    "kind", ["sign", *(pytest.param(k, marks=pytest.mark.slow) for k in ("spikes", "friction"))]
)
def test_learning_never_harms_by_much(small: Stage, kind: str) -> None:
    fault = Fault(kind, 3.0, 8.0, 2, 0.6, 5)
    frozen, learned = (small.run(fault, learning=learning) for learning in (False, True))
    found = compared(fault, frozen, learned, [])
    assert found.ratio < 1.1
    assert found.learned > 0.0
    assert found.frozen > 0.0


@pytest.mark.slow
def test_a_run_begins_with_the_same_learner_whatever_came_before(small: Stage) -> None:
    fault = Fault("nan", 3.0, 6.0, 0, 0.3, 5)
    one = small.run(fault, learning=True)
    small.run(replace(fault, kind="sign"), learning=True)
    np.testing.assert_array_equal(one["q_true"], small.run(fault, learning=True)["q_true"])


def test_a_cell_that_was_run_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, small: Stage) -> None:
    begun = []
    monkeypatch.setattr(online_faults, "stage", lambda *_: begun.append(1) or small)
    place = Place("arm4", "gp", draws=1)
    first = run_cell(place, 5, tmp_path, ("clock_stuck",))
    again = run_cell(place, 5, tmp_path, ("clock_stuck",))
    assert begun == [1]
    assert first == again
    rows = {row.metric: row for row in study_rows([("arm4", name, one) for name, one in first.items()])}
    assert rows["all_ratio_worst"].value == first["clock_stuck_0"].ratio
    assert rows["clean_ratio_worst"].value == first["clean"].ratio
    assert rows["faults_above_bar"].value == 0
