"""The table of the models for people, and the cost of using a model."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from etude.models import ExactGP, SquaredExponential
from etude_studies.model_cost import held_bytes, predict_seconds
from etude_studies.model_table import FIGURES, cells, show
from etude_studies.rows import Row


def test_models_are_rows_figures_columns_and_all_other_rows_stay(capsys, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    rows = [Row("nmse_ur10", 0.0068, "1", "linear regression", 0.2)]
    for model, factor in (("exact", 1.0), ("new_one", 2.0)):
        for i, figure in enumerate(FIGURES.values()):
            metric = figure.metric.format(model)
            rows += [Row(metric, factor * (1.5 + i), figure.unit), Row(f"{metric}_ci95", 0.25, figure.unit)]
    show(rows, "model family")
    lines = capsys.readouterr().out.splitlines()
    at = next(i for i, line in enumerate(lines) if "exact" in line)
    # of times and memory the mean alone; intervals stand below their means
    assert lines[at].split() == ["exact", "1.5", "2.5", "3.5", "4.5", "5.5", "6.5", "7.5"]
    assert lines[at + 1].split() == ["±0.25"] * 3
    assert next(line for line in lines if "new_one" in line).split()[1:3] == ["3", "5"]
    assert sum("nmse_" in line for line in lines) == 1
    assert any("nmse_ur10" in line for line in lines)
    assert not any("ci95" in line for line in lines)


def test_no_figure_is_cut_off_on_80_columns(capsys, monkeypatch) -> None:
    """Also where the output is a file: that is how a terminal without a size looks."""
    monkeypatch.setenv("COLUMNS", "80")
    values = {
        "nmse": (0.00091, 0.00026),
        "msll": (-3.6, 0.24),
        "z2": (1.8, 0.48),
        "predict_1_us": (2047.0, 1.0),
    }
    rows = []
    for name, figure in FIGURES.items():
        value, half = values.get(name, (0.45, 0.1))
        metric = figure.metric.format("dictionary_variance")
        rows += [Row(metric, value, figure.unit), Row(f"{metric}_ci95", half, figure.unit)]
    show(rows, "model family")
    out = capsys.readouterr().out
    assert "…" not in out
    assert all(text in out for text in ("dictionary_variance", "0.00091", "±0.00026", "-3.6", "2047"))


def test_what_was_not_measured_is_a_dash_and_rows_without_models_are_one_table(capsys) -> None:
    found = {"nmse_one_arm4": 0.5, "z2_one_arm4": float("nan")}
    assert cells(found, "one") == ["0.5", "–", "–", "–", "–", "–", "–"]
    show([Row("online_update_us", 1234.0, "us")], "model family")
    out = capsys.readouterr().out
    assert "online_update_us" in out
    assert "nMSE" not in out


def test_memory_counts_every_array_once_however_it_is_reached() -> None:
    a, b = np.zeros((10, 10)), np.zeros(5)
    loop = SimpleNamespace(first=a, again=a[:, 2], parts=[(b, {"k": a.T})], number=3.0, words="abc", f=len)
    loop.itself = loop
    assert held_bytes(loop) == 800 + 40
    assert held_bytes([3.0, None, "x"]) == 0
    assert held_bytes([loop, loop, b[1:]]) == 800 + 40


def test_memory_of_an_exact_posterior_is_that_of_its_arrays_and_grows_with_the_first_prediction() -> None:
    rng = np.random.default_rng(0)
    X = rng.normal(size=(40, 3))
    gp = ExactGP(SquaredExponential((0, 1, 2)), np.zeros(4), -1.0)
    posterior = gp.condition(X, rng.normal(size=40))
    own = 8 * (40 * 3 + 40 + 40 + 40 * 40 + 4)
    assert held_bytes(posterior) == own
    posterior.predict(X[:1])
    assert held_bytes(posterior) == own + 8 * 40 * 40  # the triangular inverse is kept


def test_a_prediction_is_that_of_all_outputs_at_all_inputs() -> None:
    shapes: list[tuple[int, ...]] = []
    fake = SimpleNamespace(predict=lambda X: shapes.append(X.shape))
    assert predict_seconds([fake, fake], np.zeros((7, 2)), 4) >= 0.0
    assert shapes == [(7, 2)] * 10
    with pytest.raises(AttributeError):
        predict_seconds([SimpleNamespace()], np.zeros((1, 1)), 1)  # type: ignore[list-item]
