"""Runs of chapter 6 once more: what each of them changes, and nothing else."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
import polars as pl
import pytest

from etude.protocols import Trajectory
from etude.types import Log
from etude_studies.spec import run_one
from etude_studies.thesis.arm_motions import draws, recorded, training_motions
from etude_studies.thesis.arm_runs import ARM_RUNS, MINIATURE, arm_spec
from etude_studies.thesis.arm_settings import ArmSettings
from etude_studies.thesis.catalogue import catalogue
from etude_studies.thesis.choosing import ledger
from etude_studies.thesis.readings import EQUAL, ON_PLANT, READINGS, missing, readings
from etude_studies.thesis.varied_runs import CHAOTIC, DESCENT, HEADLINES, ON_PLANTS, PLANTS, ROUNDED, STEPPED

VARIED = {**DESCENT, **ROUNDED, **ON_PLANTS}


@pytest.fixture(scope="module")
def motion() -> Trajectory:
    """The first motion of seed 3."""
    return training_motions(draws({}, 3, {}))[0]


def log_of(motion: Trajectory, **keys: Any) -> Log:
    return recorded(ArmSettings(**keys), motion, 3, 1)


def error(log: Log) -> float:
    return float(np.abs(log["q_des"] - log["q_true"]).mean())


def test_gains_friction_and_noise_change_the_arm_and_not_the_motion(motion: Trajectory) -> None:
    own = log_of(motion)
    errors = {name: error(log_of(motion, plant=factors)) for name, (_, factors) in PLANTS.items()}
    assert errors["hg"] < 0.7 * error(own) < error(own) < 0.7 * errors["lg"]
    assert errors["lf"] < 0.9 * error(own) < error(own) < 0.9 * errors["hf"]
    noisy = log_of(motion, plant={"noise": 2.0})
    np.testing.assert_array_equal(noisy["q_des"], own["q_des"])
    spread = [float((log["q"] - log["q_true"]).var()) for log in (own, noisy)]
    assert spread[1] - spread[0] == pytest.approx(3.0 * np.deg2rad(0.02) ** 2, rel=0.1)  # quantisation stays
    same = log_of(motion, plant={"gain": 1.0, "friction": 1.0, "noise": 1.0})
    np.testing.assert_array_equal(same["q"], own["q"])


def test_last_digits_differ_by_one_and_zeros_stay(motion: Trajectory) -> None:
    own, one, other = (log_of(motion, rounding=draw) for draw in (0, 1, 2))
    for name, values in own.values.items():
        away = np.abs(one[name] - values)
        assert (away <= np.spacing(np.abs(values))).all(), name
        assert ((away > 0.0) == (values != 0.0)).all(), name
    assert (own["qd_des"] == 0.0).any()
    assert (one["q"] != other["q"]).any()
    assert 0.4 < (one["q"] > own["q"]).mean() < 0.6


@pytest.mark.parametrize("name", VARIED)
def test_every_varied_run_is_its_run_but_for_the_change(name: str) -> None:
    settings = asdict(ArmSettings(**VARIED[name][1]))
    old = asdict(ArmSettings(**ARM_RUNS[name[1:3]][1]))
    away = {key for key in old if settings[key] != old[key]} - {"rounds", "beside"}
    assert away == {"G": {"model"}, "U": {"rounding"}, "V": {"plant"}}[name[0]]
    changed = {key for key, value in settings["model"].items() if old["model"].get(key) != value}
    assert changed == ({"method"} if name[0] == "G" else set())


def test_arms_are_run_on_seeds_that_no_run_before_has() -> None:
    known = {
        seed for name in HEADLINES for seed in (spec.seed for spec in catalogue()[name].specs(range(20)))
    }
    for name in ON_PLANTS:
        specs = catalogue()[name].specs(range(20))
        assert [spec.seed for spec in specs] == [*range(20, 40)]
        assert known.isdisjoint(spec.seed for spec in specs)
        assert {spec.needs[0].seed for spec in specs} == {spec.seed for spec in specs}


def test_readings_exchange_every_side_or_none() -> None:
    by_name = {own.name: own.replace for own in READINGS}
    (descent,) = (own for own in READINGS if "fixed rate" in own.name)
    assert descent.ambiguity == EQUAL
    assert {old: descent.replace[old] for old in STEPPED} == {run: f"G{run}" for run in STEPPED}
    assert descent.replace["X14"] == missing("X14")
    assert "A0" not in descent.replace  # takes no step
    assert by_name["logs with other last digits"] == {run: f"U{run}" for run in CHAOTIC}
    for plant, (what, _) in PLANTS.items():
        own = by_name[f"{ON_PLANT}{what}"]
        assert {old: own[old] for old in HEADLINES} == {run: f"V{run}{plant}" for run in HEADLINES}
        assert own["A6"] == missing("A6")


class Made:
    """Errors of A1 and A5 on one arm: the rule by error is better, on seeds 20 to 39 alone."""

    def values(self, source: str, measure: str, *_: object) -> dict[int, float]:
        level = {"VA1hg": 1.0, "VA5hg": 2.0}.get(source)
        rng = np.random.default_rng(len(source))
        return (
            {}
            if level is None or measure != "error"
            else {seed: level * float(np.exp(0.1 * rng.normal())) for seed in range(20, 40)}
        )


def test_an_arm_is_judged_on_its_own_block_of_seeds() -> None:
    plants = [own for own in READINGS if own.name.startswith(ON_PLANT)]
    planned = {"VA1hg": 20, "VA5hg": 20}
    found = {
        own.name: own.verdicts["C6.2-2"] for own in readings(ledger(), Made(), planned=planned, among=plants)
    }
    assert found["an arm with twice the feedback gains"].word == "holds"
    assert found["an arm with twice the feedback gains"].parts[0].seeds == 20
    assert found["an arm with half the feedback gains"].reason.startswith("not run yet")


@pytest.mark.slow
def test_each_way_of_varying_learns_in_miniature() -> None:
    tables = {}
    for name in ("mA1", "mGA1", "mUA1", "mVA1hg"):
        spec = arm_spec(
            {**MINIATURE[name][1], "rounds": 1, "beside": False, "described": False, "again": 0}, 3
        )
        tables[name] = run_one(spec, {own.hash: run_one(own, {}) for own in spec.needs})
    errors = {name: value(table) for name, table in tables.items()}
    assert errors["mVA1hg"] < 0.7 * errors["mA1"]
    assert errors["mGA1"] > 1.01 * errors["mA1"]  # two steps end before two line searches
    assert errors["mUA1"] == pytest.approx(errors["mA1"], rel=0.05)


def value(table: pl.DataFrame) -> float:
    keys = {"measure": "error", "test": "fourier", "part": "mean", "model": ""}
    return float(table.filter(*(pl.col(name) == own for name, own in keys.items()))["value"].item())
