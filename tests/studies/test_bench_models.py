"""The rows of `etude bench models`, at a size that takes no time."""

from __future__ import annotations

import json

import numpy as np
import pytest

from etude.studies import bench_models
from etude.studies.registry import run_bench


@pytest.fixture(autouse=True)
def small(monkeypatch) -> None:
    monkeypatch.setattr(bench_models, "SIZE", 40)
    monkeypatch.setattr(bench_models, "RATE_HZ", 10.0)
    monkeypatch.setattr(bench_models, "REPLACEMENTS", 600)


def test_dictionary_rows(capsys) -> None:
    run_bench("models", json=True, seed=1)
    rows = {row["metric"]: row for row in json.loads(capsys.readouterr().out)["rows"]}
    speed, drift = rows["dictionary_points_per_s"], rows["dictionary_drift_10k"]
    assert speed["value"] > 0.0
    assert speed["reference_value"] > 0.0
    share = int(speed["reference"].split("%")[0].split()[-1])
    assert share >= 30
    assert 0.0 < drift["value"] < 1e-7
    assert drift["reference_value"] <= drift["value"]


def test_every_measure_exists_and_the_same_seed_measures_the_same_drift() -> None:
    first, second = (bench_models.dictionary_drift_10k(np.random.default_rng(2))[0] for _ in range(2))
    assert first.value == second.value
