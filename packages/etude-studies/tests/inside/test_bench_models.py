"""The rows of `etude bench models`, at a size that takes no time."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from etude.cli import main
from etude.models import ModelConfig, ModelSelection
from etude_studies import (
    arm_accuracy,
    bench_models,
    crazyflie_accuracy,
    crazyflie_flights,
    model_latency,
    model_members,
    online_rows,
    real_accuracy,
    real_logs,
    streams,
)
from etude_studies.model_members import MEMBERS
from etude_studies.online import Cell, Outcome
from etude_studies.world import World

DICTIONARIES = ("dictionary_variance", "dictionary_error")
MODELS = (
    "exact",
    "downsampled",
    *DICTIONARIES,
    "ssgp_fixed",
    "ssgp_learned",
    "fitc",
    "vfe",
    "sogp",
    "local_gp",
    "lwpr",
)


WORLD = World.of("arm4")


def third_passes(cell: Cell, rules: dict) -> dict[str, Outcome]:
    """What `test_online` tests; here only its place among the rows."""
    return {name: Outcome([[1.0, 2.0]], (1.0, 1.0), (1.0, 1.0)) for name in rules}


WHOLE = World.learned


def few_steps(self: World, samples: Any, model: ModelConfig, *more: Any, **how: Any) -> ModelSelection:
    """A training of the real logs that is short; what it is worth is tested with them."""
    brief = replace(model, steps=4, fit_points=60, points=200, candidates=("default",))
    return WHOLE(self, samples, brief, *more, **how)


@pytest.fixture(autouse=True)
def small(monkeypatch) -> None:
    monkeypatch.setattr(bench_models, "SIZE", 40)
    monkeypatch.setattr(streams, "RATE_HZ", 10.0)
    monkeypatch.setattr(bench_models, "REPLACEMENTS", 600)
    monkeypatch.setattr(model_latency, "POINTS", 30)
    monkeypatch.setattr(model_latency, "MEMBERS", 30)
    monkeypatch.setattr(model_latency, "REPEATS", 50)
    monkeypatch.setattr(model_members, "STEPS", 8)
    monkeypatch.setattr(model_members, "KEPT", 60)
    monkeypatch.setattr(model_members, "BASIS", 20)
    monkeypatch.setattr(arm_accuracy, "TRAINING", 2)
    monkeypatch.setattr(arm_accuracy, "DURATION_S", 20.0)
    monkeypatch.setattr(arm_accuracy, "REPEATS_ONE", 5)
    monkeypatch.setattr(arm_accuracy, "REPEATS_MANY", 1)
    monkeypatch.setattr(online_rows, "outcomes_of", third_passes)
    monkeypatch.setattr(World, "learned", few_steps)


def test_all_rows_are_there_and_finite(capsys) -> None:
    bench_models.run(json=True, seed=1, quick=True)
    found = json.loads(capsys.readouterr().out)
    rows = {row["metric"]: row for row in found["rows"]}
    assert found["command"] == "etude bench models --quick --json"
    assert tuple(MEMBERS) == MODELS
    wanted = {"dictionary_points_per_s", "dictionary_drift_10k", "predict_one_point_us", "online_update_us"}
    wanted |= {"predict_one_point_structured_us", "online_pass3_deg", "online_pass3_ssgp_deg"}
    wanted |= {"nmse_ur10", "nmse_ur10_ladder", "crazyflie_motor_lag_ms"}
    for log in ("ur10", "tx40", "tiago", "crazyflie"):
        wanted |= {f"nmse_{log}", f"nmse_{log}_raw", f"nmse_{log}_worst_vs_linear"}
    wanted |= {f"{figure}_{model}_arm4" for figure in ("nmse", "z2", "msll") for model in MODELS}
    costs = ("fit_s", "predict_1_us", "predict_600_ms", "memory_mb")
    wanted |= {f"{figure}_{model}" for figure in costs for model in MODELS}
    wanted |= {f"{figure}_{model}_arm4_ci95" for figure in ("nmse", "z2", "msll") for model in MODELS}
    assert wanted <= set(rows)
    values = {name: row["value"] for name, row in rows.items() if not name.endswith("_ci95")}
    assert all(row["value"] is not None for row in rows.values())
    assert all(value > 0.0 for name, value in values.items() if not name.startswith("msll_"))
    assert rows["msll_exact_arm4"]["value"] < -0.5
    assert rows["nmse_exact_arm4"]["ratio"] < 0.5
    assert rows["nmse_exact_arm4"]["reference"] == "linear regression, 2 seeds"
    assert len({rows[f"nmse_{model}_arm4"]["reference_value"] for model in MODELS}) == 1
    assert rows["nmse_ur10"]["ratio"] < 0.2
    share = int(rows["dictionary_points_per_s"]["reference"].split("%")[0].split()[-1])
    assert share >= 30
    drift = rows["dictionary_drift_10k"]
    assert 0.0 < drift["value"] < 1e-7
    assert drift["reference_value"] <= drift["value"]


def test_every_measure_exists_and_the_same_seed_measures_the_same_drift() -> None:
    first, second = (bench_models.dictionary_drift_10k(np.random.default_rng(2))[0] for _ in range(2))
    assert first.value == second.value


def test_training_and_test_motions_differ_and_the_same_seed_makes_the_same() -> None:
    (train, test), (again, _) = (arm_accuracy.arm_data(WORLD, np.random.default_rng(3)) for _ in range(2))
    assert np.array_equal(train.command, again.command)
    assert set(train.group) == {0, 1}
    assert set(test.group) == {2}
    for motion in (train.take(train.group == 0), train.take(train.group == 1)):
        assert np.abs(motion.log["q"][:50] - test.log["q"][:50]).max() > 0.05


def test_figures_are_those_of_the_definitions(monkeypatch) -> None:
    class Ignorant:
        """Predicts nothing beyond the mean, with variance 1 and noise 3."""

        noise_variance = 3.0

        def predict(self, X):
            return np.zeros(len(X)), np.ones(len(X))

    monkeypatch.setattr(arm_accuracy, "MEMBERS", {"mean": lambda X, y, floor, rng: Ignorant()})
    monkeypatch.setattr(arm_accuracy, "QUICK_SEEDS", 1)
    rows = arm_accuracy.member_rows(np.random.default_rng(5), quick=True)
    nmse, msll, z2, *costs = rows
    train, test = arm_accuracy.arm_data(WORLD, np.random.default_rng(5).spawn(1)[0])
    errors, wanted, gains = [], [], []
    for j in range(4):
        command, known = (part.command[part.moving[:, j], j] for part in (test, train))
        errors.append(float(np.mean((command - known.mean()) ** 2)))
        wanted.append(errors[-1] / float(np.var(command)))
        own, plain = (norm(known.mean(), deviation).logpdf(command) for deviation in (2.0, known.std()))
        gains.append(float(np.mean(plain - own)))
    assert nmse.value == pytest.approx(np.mean(wanted))
    assert z2.value == pytest.approx(np.mean(errors) / 4.0)
    assert msll.value == pytest.approx(np.mean(gains))
    assert [row.metric for row in (nmse, msll, z2)] == ["nmse_mean_arm4", "msll_mean_arm4", "z2_mean_arm4"]
    names = [f"{figure}_mean" for figure in ("fit_s", "predict_1_us", "predict_600_ms", "memory_mb")]
    assert [row.metric for row in costs] == names
    assert costs[-1].value == 0.0  # it holds no array


def test_quick_has_fewer_seeds(monkeypatch) -> None:
    monkeypatch.setattr(arm_accuracy, "SEEDS", 3)
    monkeypatch.setattr(arm_accuracy, "MEMBERS", {"downsampled": MEMBERS["downsampled"]})
    named = {
        quick: arm_accuracy.member_rows(np.random.default_rng(4), quick=quick)[0].reference
        for quick in (True, False)
    }
    assert named == {True: "linear regression, 2 seeds", False: "linear regression, 3 seeds"}


def test_without_the_log_its_rows_are_left_out_with_a_message(monkeypatch, capsys, tmp_path: Path) -> None:
    monkeypatch.setattr(real_logs, "EXAMPLES", tmp_path)
    monkeypatch.setattr(crazyflie_flights, "EXAMPLES", tmp_path)
    assert real_accuracy.real_rows(np.random.default_rng(0)) == []
    assert crazyflie_accuracy.crazyflie_accuracy_rows(np.random.default_rng(0)) == []
    printed = capsys.readouterr()
    for log in ("ur10", "tx40", "tiago", "crazyflie"):
        assert f"nmse_{log} left out" in printed.err
    assert "panda" not in printed.err
    assert printed.out == ""


def test_the_command_runs_it_with_the_options_that_it_knows(monkeypatch, capsys) -> None:
    seen = []

    def run(*, json: bool, seed: int, quick: bool = False) -> None:
        seen.append((json, seed, quick))

    monkeypatch.setattr(bench_models, "run", run)
    assert main(["bench", "models", "--seed", "5", "--quick"]) == 0
    assert seen == [(False, 5, True)]
    assert main(["bench", "models", "--logs", "."]) == 2
    assert "does not take --logs" in capsys.readouterr().err
