from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
import pytest
from made_up_orders import made_up
from scipy.stats import ttest_rel

from etude_studies.flight_orders_cell import CRITERIA
from etude_studies.flight_orders_rows import compare, order_rows
from etude_studies.flight_orders_verdicts import at_least, at_most, ordering, verdict_rows
from etude_studies.paired import Paired, paired
from etude_studies.rows import rows_json

FACTOR = {"uniform": 1.0, "scaled": 2.0, "boundary": 0.5, "mean_variance": 1.6, "info_gain": 1.25}


close = partial(math.isclose, rel_tol=1e-3)


def level(arm: str, test: str) -> float:
    """Designs are worse on uniform tests and better on the extremes."""
    factor = FACTOR.get(arm, 0.8)
    return 0.01 * (1.0 / factor if test == "extremes" else factor)


def some_cells(count: int = 3, spread: float = 1e-4) -> list[dict[str, Any]]:
    """Seeds that differ much in all arms, and by `spread` in what a design is worth."""

    def error(seed: int, arm: str, test: str) -> float:
        luck = spread * (seed % 2) if arm in CRITERIA else 0.0
        return (1.0 + seed) * level(arm, test) * math.exp(luck)

    return [
        made_up(seed, partial(error, seed), lambda arm: 0.5 if arm == "ivr" else 1.0) for seed in range(count)
    ]


def test_ratio_and_interval_in_closed_form() -> None:
    # logs 0.1 and 0.5: mean 0.3, standard error 0.2, t quantile of one degree of freedom 12.7062
    found = paired([2.0 * math.exp(0.1), 7.0 * math.exp(0.5)], [2.0, 7.0])
    assert math.isclose(found.ratio, math.exp(0.3))
    assert math.isclose(found.low, math.exp(0.3 - 12.7062047 * 0.2), rel_tol=1e-7)
    assert math.isclose(found.high, math.exp(0.3 + 12.7062047 * 0.2), rel_tol=1e-7)
    assert math.isnan(paired([1.0], [2.0]).low)


def test_interval_is_that_of_a_paired_t_test() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.lognormal(size=(2, 9))
    own = ttest_rel(np.log(a), np.log(b)).confidence_interval(0.95)
    found = paired(a.tolist(), b.tolist())
    assert np.allclose([found.low, found.high], np.exp([own.low, own.high]))


def test_seeds_cancel_in_a_pair() -> None:
    # errors differ fourfold between seeds, the ratio not at all
    found = compare(some_cells(4, spread=0.0), "mean_variance", "uniform", "uniform")
    assert math.isclose(found.ratio, 1.0 / 1.6)
    assert math.isclose(found.low, found.high)


def test_rows_of_ratios() -> None:
    rows = {row.metric: row for row in order_rows("clean", some_cells())}
    assert close(rows["clean_mean_variance_vs_random_mae_uniform"].value, 1.0 / 1.6)
    assert close(rows["clean_mean_variance_vs_scaled_mae_uniform"].value, 2.0 / 1.6)
    assert close(rows["clean_mean_variance_vs_boundary_mae_extremes"].value, 1.6 / 0.5)
    assert close(rows["clean_ivr_vs_random_mae_uniform"].value, 1.0 / 0.8)
    assert close(rows["clean_ivr_vs_random_mae_ladder_uniform"].value, 1.0 / 0.8)
    assert close(rows["clean_ivr_vs_random_sd"].value, 2.0)
    assert close(rows["clean_uniform_5_mae_uniform"].value, 0.02)
    low, high = (rows[f"clean_ivr_vs_random_mae_uniform_{end}"].value for end in ("low", "high"))
    assert low < 1.25 < high
    assert len(rows) == len(order_rows("clean", some_cells()))  # no name twice
    rows_json(list(rows.values()), "etude study quadrotor")


@pytest.mark.parametrize(
    ("low", "high", "least", "most", "order"),
    [
        (1.2, 1.5, "holds", "does not hold", "the design is better"),
        (0.9, 1.3, "not shown", "not shown", "no difference shown"),
        (0.5, 0.9, "does not hold", "holds", "reversed: random is better"),
    ],
)
def test_wording(low: float, high: float, least: str, most: str, order: str) -> None:
    found = Paired(math.sqrt(low * high), low, high, 8)
    assert at_least(found, 1.1) == least
    assert at_most(found, 1.1) == most
    assert ordering(found) == order


def test_verdicts() -> None:
    rows = {row.metric: row for row in verdict_rows({"thesis": some_cells(), "clean": some_cells()})}
    said = {name.removeprefix("verdict_"): row.reference for name, row in rows.items()}
    assert said["clean_ivr_not_worse_5"].startswith("holds: ivr is not significantly worse")
    assert said["clean_ivr_sd"].startswith("holds: ivr predicts a deviation at least 1.05 times lower")
    # 0.8 over 0.8 and, on extremes, 1/0.8 over 1/1.25
    assert said["clean_log_ivr_within_uniform"].startswith("holds: log_ivr is within 15 %")
    assert said["clean_log_ivr_within_extremes"].startswith("does not hold: ")
    assert "info_gain" in said["clean_log_ivr_within_extremes"]
    assert said["clean_mean_variance_extremes"].startswith("holds: mean_variance beats uniform random")
    assert said["clean_order_mean_variance_uniform_uniform"].startswith("reversed: random is better")
    assert said["clean_order_mean_variance_scaled_uniform"].startswith("the design is better")
    assert said["clean_order_mean_variance_uniform_extremes"].startswith("the design is better")
    assert said["thesis_gp_below_analytic"].startswith("holds")  # equal by construction
    assert said["thesis_row_l"].startswith("does not hold")  # 0.625, outside 0.67 .. 0.92
    assert said["clean_z2_gp"].startswith("holds: z2 of gp after 4 flights")
    assert said["clean_coverage_ladder"].startswith("holds: ")
    assert "3 seeds" in said["clean_ivr_sd"]


def test_a_worse_ivr_is_said_to_be_worse() -> None:
    cells = [made_up(s, lambda arm, _, s=s: 0.01 * (1.3 + 1e-6 * s if arm == "ivr" else 1.0)) for s in (0, 1)]
    rows = {row.metric: row.reference for row in verdict_rows({"clean": cells})}
    assert rows["verdict_clean_ivr_not_worse_2"].startswith("does not hold")


@pytest.mark.parametrize(
    ("factor", "verdict"), [(1.3, "holds"), (1.6, "does not hold"), (0.9, "does not hold")]
)
def test_the_order_after_the_longest_flights(factor: float, verdict: str) -> None:
    cells = [
        made_up(s, lambda arm, _, s=s: 0.01 * (factor + 1e-4 * s if arm == "mean_variance" else 1.0))
        for s in range(3)
    ]
    rows = {row.metric: row.reference for row in verdict_rows({"thesis": cells})}
    assert rows["verdict_thesis_row_l"].startswith(verdict)


def test_a_study_of_few_arms_has_fewer_verdicts() -> None:
    cells = [made_up(s, lambda *_: 0.01, arms=("uniform", "ivr"), flights=2) for s in (0, 1)]
    names = {row.metric for row in verdict_rows({"clean": cells})}
    assert "verdict_clean_ivr_not_worse_2" in names
    assert not any("log_ivr" in name or "z2" in name for name in names)
