"""The study in the quadrotor's loop: paired, resumable, rows beside PID alone."""

import json

import numpy as np
import pytest

from etude.errors import UsageError
from etude_studies import flight_loop
from etude_studies.flight_loop import Cell, loop_rows, run, run_one, seed_errors

CELL = Cell("quadrotor", "moving", 2, 5)


@pytest.fixture(scope="module")
def errors():
    return seed_errors(CELL, tests=1, learned_from=(1,))


def test_what_is_learned_helps_and_what_is_disturbed_hurts(errors):
    # without noise one flight teaches what the analytic model gets wrong, its drag, as well as can be known
    assert errors["learned_1/calm"] < 1.05 * errors["exact_drag/calm"] < 0.75 * errors["analytic/calm"]
    assert errors["analytic/calm"] < 0.85 * errors["pid/calm"]
    # a steady wind may help on a single test flight; a gust comes from nowhere
    assert errors["exact_drag/gust"] > 1.2 * errors["exact_drag/calm"]
    assert {name.split("/")[1] for name in errors} == {"calm", "wind", "gust", "sag"}
    assert all(np.isfinite(value) for value in errors.values())


def test_a_finished_cell_is_read_not_run(tmp_path, monkeypatch):
    (tmp_path / f"{CELL.name}.json").write_text(json.dumps({"pid/calm": 0.25}))
    monkeypatch.setattr(flight_loop, "seed_errors", None)
    assert run_one(CELL, tmp_path) == (CELL, {"pid/calm": 0.25})


def test_rows_are_means_beside_pid_in_the_same_air():
    found = [{"pid/calm": 0.4, "learned_4/calm": 0.1}, {"pid/calm": 0.6, "learned_4/calm": 0.2}]
    rows = {row.metric: row for row in loop_rows("q", found)}
    assert rows["q_learned_4_calm_m"].value == pytest.approx(0.15)
    assert rows["q_learned_4_calm_m"].reference_value == pytest.approx(0.5)
    # two seeds, 0.05 either side: t(0.975, 1) * 0.0707 / sqrt(2)
    assert rows["q_learned_4_calm_m_ci95"].value == pytest.approx(12.7062 * 0.05, rel=1e-4)


def test_one_seed_makes_no_interval(tmp_path):
    with pytest.raises(UsageError, match="2 seeds or more"):
        run(json=True, seed=0, seeds=1, folder=tmp_path)
