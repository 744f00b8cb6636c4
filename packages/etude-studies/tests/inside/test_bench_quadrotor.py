from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from made_up_orders import made_up

from etude import plugins
from etude_studies import bench_quadrotor
from etude_studies.bench_quadrotor import FULL, QUICK, order_bench_rows, tracking_rows
from etude_studies.flight_orders_cell import Effort
from etude_studies.rows import Row


def test_the_bench_runs_every_measure(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[bool] = []
    assert plugins.load("etude.studies", "bench_quadrotor") is bench_quadrotor.run

    def measure(rng: np.random.Generator, quick: bool) -> list[Row]:
        asked.append(quick)
        return [Row(f"row_{len(asked)}", float(rng.integers(10)), "1")]

    monkeypatch.setattr(bench_quadrotor, "MEASURES", (measure, measure))
    bench_quadrotor.run(json=True, quick=True)
    said = json.loads(capsys.readouterr().out)
    assert said["command"] == "etude bench quadrotor --quick --json"
    assert [row["metric"] for row in said["rows"]] == ["row_1", "row_2"]
    assert asked == [True, True]
    assert said["rows"][0]["value"] == said["rows"][1]["value"]  # the same seed for each


def test_quick_measures_what_the_full_bench_does() -> None:
    assert QUICK.arms == FULL.arms
    assert QUICK.flights >= 4  # calibration is claimed from four flights on
    assert QUICK.design == FULL.design


def test_orders(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[Any] = []

    def measured(preset: str, seed: int, extremes: Any, effort: Effort) -> dict[str, Any]:
        given.append((preset, seed, {name: len(own) for name, own in extremes.items()}))
        error = {"ivr": 0.5, "mean_variance": 1.25}
        return made_up(seed, lambda arm, _: error.get(arm, 1.0), lambda arm: 1.0 / (1.0 + (arm == "ivr")))

    flights = {"flights": {"mean_variance": [[1.0]], "info_gain": [[2.0]]}}
    monkeypatch.setattr(bench_quadrotor, "designed_flights", lambda *_: flights)
    monkeypatch.setattr(bench_quadrotor, "cell_measures", measured)
    rows = {row.metric: row for row in order_bench_rows(np.random.default_rng(0), quick=True)}
    assert np.isclose(rows["ivr_vs_random_mae_uniform"].value, 2.0)
    assert np.isclose(rows["ivr_vs_random_sd"].value, 2.0)
    assert np.isclose(rows["mean_variance_vs_random_extremes"].value, 0.8)
    assert np.isclose(rows["mean_variance_vs_random_extremes_high"].value, 0.8)
    assert rows["z2_uniform"].value == 1.0
    assert len({seed for _, seed, _ in given}) == len(given) >= 5
    assert all(own == {"mean_variance": 2, "info_gain": 2} for _, _, own in given)


def test_a_flight_is_flown_and_timed() -> None:
    (row,) = bench_quadrotor.flight_cost_rows(np.random.default_rng(0))
    assert row.metric == "flight_cpu_s"
    assert row.value > 0.0
    assert row.reference_value == 0.1


def test_tracking(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def made_up(cell: Any, tests: int, learned_from: tuple[int, ...]) -> dict[str, float]:
        asked.append((cell.seed, tests, learned_from))
        own = float(len(asked))
        return {"pid/calm": 0.5 * own, "exact_drag/calm": 0.05, "learned_4/calm": 0.06 * own}

    monkeypatch.setattr(bench_quadrotor, "seed_errors", made_up)
    rows = {row.metric: row for row in tracking_rows(np.random.default_rng(0), seeds=2, tests=3)}
    assert np.isclose(rows["pid_error_m"].value, 0.75)
    assert np.isclose(rows["pid_error_m"].reference_value, 0.05)
    assert np.isclose(rows["feedforward_error_m"].value, 0.09)
    assert asked[1][0] == asked[0][0] + 1
    assert {own[1:] for own in asked} == {(3, (4,))}
