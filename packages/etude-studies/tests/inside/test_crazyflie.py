"""The real flights: what is held out stays held out, figures are those defined, and the model doubts."""

from __future__ import annotations

import json

import numpy as np
import pytest

from etude.models import block_masks
from etude.types import Log
from etude_studies import crazyflie
from etude_studies import crazyflie_flights as study
from etude_studies.crazyflie import crazyflie_rows
from etude_studies.rows import Row


@pytest.fixture(scope="module")
def flights() -> dict[int, list[Log]]:
    return study.crazyflie_flights()


@pytest.fixture(scope="module")
def rows() -> dict[str, Row]:
    return {row.metric: row for row in crazyflie_rows(np.random.default_rng(0), quick=True)}


def test_rows_are_named_and_finite(rows) -> None:
    named = {
        "crazyflie_nmse",
        "crazyflie_nmse_unseen",
        "crazyflie_lag_ms",
        "crazyflie_unseen_deviation_ratio",
    }
    named |= {"crazyflie_z2", "crazyflie_coverage", "crazyflie_nmse_rigid_body"}
    assert named <= set(rows)
    assert all(np.isfinite(row.value) for row in rows.values())


def test_the_model_beats_what_is_simpler(rows) -> None:
    assert rows["crazyflie_nmse"].value <= 0.15  # the project's number
    assert rows["crazyflie_nmse"].ratio < 1.0
    assert rows["crazyflie_nmse_unseen"].ratio < 1.0


def test_a_manoeuvre_that_was_not_learned_is_doubted(rows) -> None:
    assert rows["crazyflie_unseen_deviation_ratio"].value > 2.0
    assert 0.5 < rows["crazyflie_unseen_z2_yaw"].value < 2.0


def test_training_pieces_keep_away_from_the_test(flights) -> None:
    (log,) = flights[10]
    pieces = study.training_pieces([log])
    assert len(pieces) == 5
    held = log.t[block_masks(log.t)[1]]
    assert len(held) == pytest.approx(0.2 * len(log), abs=4)
    times = np.concatenate([piece.t for piece in pieces])
    assert np.abs(times[:, None] - held).min() >= study.GAP_S - 1e-9
    assert 0.02 < study.lag_of([log]) < 0.08


def test_samples_and_recorded_set_points_are_of_the_same_times(flights) -> None:
    (log,) = flights[15]
    data, raw = study._samples(log, 15, 0.042)
    # the mean over 40 ms and its middle differ by noise alone; a sample's shift would be seen
    near = np.mean((data.command - raw) ** 2)
    late = np.mean((data.command[1:] - raw[:-1]) ** 2)
    assert near < 0.1 * late
    assert data.t[1] - data.t[0] == pytest.approx(0.04)


def test_errors_are_of_the_definition() -> None:
    rng = np.random.default_rng(0)
    command = rng.normal(size=(400, 4)) * [1.0, 2.0, 3.0, 4.0]
    assert study.nmse(command, command.mean(axis=0)) == pytest.approx(1.0)
    assert study.nmse(command, command) == 0.0


def test_the_bench_prints_its_rows(monkeypatch, capsys) -> None:
    monkeypatch.setattr(
        crazyflie, "crazyflie_rows", lambda rng, quick: [Row("crazyflie_nmse", 0.1 + quick, "1")]
    )
    crazyflie.run(json=True, seed=0, quick=True)
    found = json.loads(capsys.readouterr().out)
    assert found["command"] == "etude bench crazyflie --quick --json"
    assert found["rows"][0]["value"] == 1.1
    crazyflie.run(json=False, seed=0)
    assert "crazyflie_nmse" in capsys.readouterr().out
