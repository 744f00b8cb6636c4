"""The machine interface for figures."""

from __future__ import annotations

import json

import numpy as np
import pytest

from etude.models import ExactGP
from etude_studies import bench_gp, rows
from etude_studies.rows import Row, rows_json


def test_a_row_knows_its_ratio() -> None:
    assert Row("a", 3.0, "ms", "b", 2.0).ratio == 1.5
    assert Row("a", 3.0, "ms").ratio is None
    assert Row("a", 3.0, "ms", "b", 0.0).ratio is None


def test_the_line_is_one_line_of_strict_json() -> None:
    line = rows_json([Row("a", 3.0, "ms", "b", 2.0), Row("c", float("nan"), "deg")], "etude bench gp --json")
    assert "\n" not in line
    found = json.loads(line)
    assert set(found) == {"rows", "commit", "command"}
    keys = {"metric", "value", "unit", "reference", "reference_value", "ratio"}
    assert all(set(row) == keys for row in found["rows"])
    assert found["rows"][0]["ratio"] == 1.5
    assert found["rows"][1]["value"] is None
    assert found["command"] == "etude bench gp --json"


def test_without_git_the_version_stands_for_the_commit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    assert rows.commit() == rows.version("etude")


@pytest.fixture
def small_bench(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_gp, "LIKELIHOOD_REPEATS", {500: 1})
    monkeypatch.setattr(bench_gp, "POINTS", 500)
    monkeypatch.setattr(bench_gp, "GRADIENT_REPEATS", 1)
    monkeypatch.setattr(bench_gp, "beside_others", lambda *_: [])


@pytest.mark.usefixtures("small_bench")
def test_bench_rows_have_their_names_and_references(capsys: pytest.CaptureFixture[str]) -> None:
    bench_gp.run(json=True)
    found = json.loads(capsys.readouterr().out.splitlines()[-1])
    names = [row["metric"] for row in found["rows"]]
    assert names == ["nlml_gradient_n500", "mean_variance_gradient_n500", "ivr_gradient_n500"]
    assert found["rows"][0]["reference"] == "dpotrf+dpotri"
    assert all(row["value"] > 0.0 and row["reference_value"] > 0.0 for row in found["rows"])
    bench_gp.run()
    assert "nlml_gradient_n500" in capsys.readouterr().out


def test_the_bench_covers_the_three_sizes() -> None:
    assert list(bench_gp.LIKELIHOOD_REPEATS) == [500, 1000, 3000]
    gp, X, y = bench_gp.random_process(20, np.random.default_rng(0))
    assert isinstance(gp, ExactGP)
    assert X.shape == (20, 12)
    assert y.shape == (20,)
