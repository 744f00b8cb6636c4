"""The study of design: rows are paired ratios, seconds first passages, and finished cells are kept."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from etude.trajectories import segment_starts
from etude_studies import design, design_flights
from etude_studies.design import cell, ratio_rows, rows_of, seconds_rows
from etude_studies.design_arms import arm_of
from etude_studies.design_parts import PARTS, pick_and_place


def test_ratios_are_geometric_and_paired() -> None:
    rows = {r.metric: r for r in ratio_rows("x", [1.0, 4.0, 2.0], [2.0, 4.0, 8.0], "random 60 s gp")}
    assert rows["x_over_random"].value == pytest.approx(0.5)
    half = 4.302653 * np.std(np.log([0.5, 1.0, 0.25]), ddof=1) / 3**0.5
    assert rows["x_over_random_high"].value == pytest.approx(0.5 * np.exp(half), rel=1e-5)
    assert rows["x_over_random_low"].value == pytest.approx(0.5 * np.exp(-half), rel=1e-5)
    assert (rows["x_over_random_worst"].value, rows["x_over_random_worst"].reference_value) == (4.0, 8.0)


def test_every_figure_stands_beside_that_of_random_motions(tmp_path: Path) -> None:
    for seed, factor in ((1, 0.5), (2, 0.25)):
        found = {"repeated gp": 8.0, "random gp": 4.0, "designed gp": 4.0 * factor, "random seconds": 68.0}
        (tmp_path / f"chain_seven_{seed:04d}.json").write_text(json.dumps(found))
    rows = {row.metric: row.value for row in rows_of(tmp_path, range(1, 4))}
    assert rows["chain_seven_designed_gp_over_random"] == pytest.approx(0.125**0.5)
    assert rows["chain_seven_designed_gp_over_repeated"] == pytest.approx(0.5 * 0.125**0.5)
    assert rows["chain_seven_random_gp_over_repeated"] == pytest.approx(0.5)
    assert rows["chain_seven_random_seconds"] == 68.0
    assert not any(name.startswith("first") for name in rows)


def test_seconds_are_those_of_the_first_error_below() -> None:
    cells = [
        {"random 30 s after 30": 0.6, "random 30 s after 60": 0.45, "random 30 s after 90": 0.15},
        {"random 30 s after 30": 0.4, "random 30 s after 60": 0.45, "random 30 s after 90": 0.35},
    ]
    rows = {row.metric: row.value for row in seconds_rows("a", cells)}
    assert rows["seconds_a_random_30_to_0.5"] == 45.0
    assert rows["seconds_a_random_30_to_0.2"] == (90.0 + 240.0) / 2.0


def test_a_finished_cell_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PARTS, "first", (lambda name, seed: {"error": float(seed)}, ("arm4",)))
    assert cell("first", "arm4", 3, tmp_path) == {"error": 3.0}
    monkeypatch.setitem(PARTS, "first", (lambda *_: pytest.fail("run again"), ("arm4",)))
    assert cell("first", "arm4", 3, tmp_path) == {"error": 3.0}
    assert design.PARTS is PARTS


def test_the_fast_arm_has_three_segments_a_minute_and_its_groups() -> None:
    arm, rng = arm_of("seven"), np.random.default_rng(0)
    motion = arm.chained(arm.random(rng, 3))
    assert len(segment_starts(motion)) == 3
    lengths = [piece.duration for _, label, piece in motion.pieces() if label == "segment"]
    assert lengths == pytest.approx([20.0] * 3)
    samples = arm.samples([(motion, arm.recorded(motion, rng))] * 2)
    assert np.unique(samples.group).tolist() == [0, 1, 2, 3, 4, 5]
    repeated = arm.having(duration=60.0, omega0=2 * np.pi / 20.0).random(rng, 1)[0]
    again = repeated.motion(np.array([3.0, 23.0]), 1)
    np.testing.assert_allclose(again.orders[0, 0], again.orders[0, 1], atol=1e-9)


def test_a_pick_and_place_lasts_about_a_minute_inside_the_limits() -> None:
    arm = arm_of("arm4_rough")
    for seed in range(5):
        task = pick_and_place(arm, np.random.default_rng(seed))
        assert 30.0 < task.duration < 90.0
        q, qd, _ = task.motion(np.linspace(0.0, task.duration, 2000)).orders
        spec = arm.world.spec
        assert np.all((q > spec.lower) & (q < spec.upper) & (np.abs(qd) < spec.velocity))


def test_flights_are_compared_at_equal_seconds_and_the_later_lean(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(design_flights, "LENGTHS", (5.0, 10.0))
    monkeypatch.setattr(design_flights, "SECONDS", 10.0)
    found = design_flights.flights("quadrotor_rough", 3)
    errors = {key for key in found if "after" in key}
    assert errors == {"5-s after 5 s", "5-s after 10 s", "10-s after 10 s"}
    assert all(0.0 < found[key] < 5.0 for key in errors)
    assert found["5-s farthest 2"] < found["5-s farthest 1"]  # the second is flown with the drag of the first


def test_short_flights_are_held_against_long_ones_in_metres(tmp_path: Path) -> None:
    for seed in (1, 2):
        found = {"15-s after 30 s": 0.1 * seed, "30-s after 30 s": 0.4 * seed}
        (tmp_path / f"flights_quadrotor_rough_{seed:04d}.json").write_text(json.dumps(found))
    rows = {row.metric: row for row in rows_of(tmp_path, (1, 2))}
    assert rows["flights_quadrotor_rough_15-s_after_30_s"].unit == "m"
    assert rows["flights_quadrotor_rough_15-s_after_30_s_over_30-s"].value == pytest.approx(0.25)


def test_flights_are_judged_by_what_their_certificates_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(design_flights, "FLIGHTS", 1)
    found = design_flights.room("quadrotor_rough", 3)
    assert set(found) == {"left", "flights", "of margin 1"}
    assert found["flights"] - found["left"] == 1.0
    away = found["of margin 1"] * 1.0  # m: what the vehicle's file keeps before any log
    assert 0.2 < away < 5.0
