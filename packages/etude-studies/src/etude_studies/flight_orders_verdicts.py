"""Verdicts of the study of flights: a row of its figure, the bound, and one plain sentence.

A claim about a mean "holds" if the whole 95 % interval is on its side of the bound, "does not hold" if the
whole interval is on the other, and is "not shown" in between: the point estimate then says what is likelier.
A claim "never significantly worse" is another kind: it holds as long as no interval lies wholly on the worse
side of 1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from etude_studies.flight_orders_cell import BASELINES, CRITERIA
from etude_studies.flight_orders_rows import (
    RANDOM,
    TESTS,
    Cells,
    arms_of,
    compare,
    compare_deviation,
    figures,
    last_count,
)
from etude_studies.paired import Paired, paired
from etude_studies.rows import Row

ROW_L = (0.67, 0.92)
"""Random over max-variance after ten flights of the thesis's protocol, in the prototype: its interval."""
AVERAGE_AND_WORST = ("uniform", "extremes")
WITHIN = 1.15
CALIBRATED = (0.5, 2.0)
LEAST_COVERAGE = 0.9
CALIBRATED_FROM = 4


def verdict_rows(cells_by_preset: Mapping[str, Cells]) -> list[Row]:
    """All claims whose arms and counts the study has, by preset; needs two seeds."""
    rows: list[Row] = []
    for preset, cells in cells_by_preset.items():
        arms = arms_of(cells)
        if "ivr" in arms:
            rows += _ivr(preset, cells)
        if {"ivr", "log_ivr", "info_gain"} <= set(arms):
            rows += _log_ivr(preset, cells)
        rows += _extremes(preset, cells)
        rows += _orderings(preset, cells)
    for preset in ("thesis", "literal"):
        if preset in cells_by_preset:
            rows += _thesis(preset, cells_by_preset[preset])
    if "clean" in cells_by_preset and last_count(cells_by_preset["clean"]) >= CALIBRATED_FROM:
        rows += _calibration("clean", cells_by_preset["clean"])
    return rows


def at_least(ratio: Paired, bound: float) -> str:
    """Verdict on "at least `bound`"."""
    if ratio.low >= bound:
        return "holds"
    return "does not hold" if ratio.high < bound else "not shown"


def at_most(ratio: Paired, bound: float) -> str:
    """Verdict on "at most `bound`"."""
    if ratio.high <= bound:
        return "holds"
    return "does not hold" if ratio.low > bound else "not shown"


def ordering(ratio: Paired) -> str:
    """Who is better, where `ratio` is the baseline's error over the design's."""
    if ratio.low > 1.0:
        return "the design is better"
    return "reversed: random is better" if ratio.high < 1.0 else "no difference shown"


def _row(name: str, ratio: Paired, bound: float, verdict: str, claim: str) -> Row:
    return Row(f"verdict_{name}", ratio.ratio, "1", f"{verdict}: {claim} ({ratio.words})", bound)


def _ivr(preset: str, cells: Cells) -> list[Row]:
    rows = []
    for count in range(2, last_count(cells) + 1):
        ratio = compare(cells, "ivr", RANDOM, "uniform", count)
        verdict = "does not hold" if ratio.high < 1.0 else "holds"
        claim = f"ivr is not significantly worse than uniform random on uniform tests, {count} flights"
        rows.append(_row(f"{preset}_ivr_not_worse_{count}", ratio, 1.0, verdict, claim))
    for name, label in {"sd": "common hyperparameters", "sd_in_use": "the models in use"}.items():
        ratio = compare_deviation(cells, "ivr", name)
        claim = f"ivr predicts a deviation at least 1.05 times lower on the reference set, {label}"
        rows.append(_row(f"{preset}_ivr_{name}", ratio, 1.05, at_least(ratio, 1.05), claim))
    return rows


def _log_ivr(preset: str, cells: Cells) -> list[Row]:
    rows, last = [], last_count(cells)
    for test in AVERAGE_AND_WORST:
        errors = {arm: figures(cells, arm, last, test) for arm in ("ivr", "info_gain")}
        better = min(errors, key=lambda arm: float(np.mean(np.log(errors[arm]))))
        ratio = paired(figures(cells, "log_ivr", last, test), errors[better])
        claim = f"log_ivr is within 15 % of the better of ivr and info_gain ({better}) on {test} tests"
        name = f"{preset}_log_ivr_within_{test}"
        rows.append(_row(name, ratio, WITHIN, at_most(ratio, WITHIN), claim))
    return rows


def _extremes(preset: str, cells: Cells) -> list[Row]:
    rows = []
    for arm in ("mean_variance", "info_gain"):
        if arm in arms_of(cells):
            ratio = compare(cells, arm, RANDOM, "extremes")
            claim = f"{arm} beats uniform random on the extremes by at least 1.1 times"
            rows.append(_row(f"{preset}_{arm}_extremes", ratio, 1.1, at_least(ratio, 1.1), claim))
    return rows


def _orderings(preset: str, cells: Cells) -> list[Row]:
    """The thesis's ordering, optimised better than random, under each baseline and on each test set."""
    rows, arms = [], arms_of(cells)
    for arm in (option for option in CRITERIA if option in arms):
        for baseline in (option for option in BASELINES if option in arms):
            for test in TESTS:
                ratio = compare(cells, arm, baseline, test)
                claim = f"{arm} against {baseline} random on {test} tests"
                name = f"{preset}_order_{arm}_{baseline}_{test}"
                rows.append(_row(name, ratio, 1.0, ordering(ratio), claim))
    return rows


def _thesis(preset: str, cells: Cells) -> list[Row]:
    """The prototype's row L: the process below the analytic model by flight 3, and the order at ten."""
    rows, last = [], last_count(cells)
    if last >= 3:
        errors = {kind: figures(cells, RANDOM, 3, "uniform", "mae", kind) for kind in ("gp", "nominal")}
        ratio = paired(errors["nominal"], errors["gp"])
        claim = "the process is below the analytic model by flight 3 (uniform random, uniform tests)"
        rows.append(_row(f"{preset}_gp_below_analytic", ratio, 1.0, at_least(ratio, 1.0), claim))
    if "mean_variance" not in arms_of(cells):
        return rows
    rounds = [cell["measured"][arm] for cell in cells for arm in (RANDOM, "mean_variance")]
    longest = min(max(int(n) for n in flights) for flights in rounds)
    ratio = compare(cells, "mean_variance", RANDOM, "uniform", longest)
    verdict = "not shown" if ratio.low <= ROW_L[1] and ratio.high >= ROW_L[0] else "does not hold"
    if ROW_L[0] <= ratio.ratio <= ROW_L[1]:
        verdict = "holds"
    claim = f"random over mean_variance after {longest} flights is 0.67 .. 0.92, as in the prototype"
    return [*rows, _row(f"{preset}_row_l", ratio, 0.78, verdict, claim)]


def _calibration(preset: str, cells: Cells) -> list[Row]:
    rows = []
    for kind in ("gp", "ladder"):
        z2, coverage = (
            figures(cells, RANDOM, CALIBRATED_FROM, "uniform", name, kind) for name in ("z2", "coverage")
        )
        inside = CALIBRATED[0] <= float(np.mean(z2)) <= CALIBRATED[1]
        summary = f"mean over {len(z2)} seeds, least {min(z2):.2f}, most {max(z2):.2f}"
        claim = f"z2 of {kind} after 4 flights is in 0.5 .. 2 on uniform tests ({summary})"
        rows.append(_level(f"{preset}_z2_{kind}", z2, 1.0, inside, claim))
        enough = float(np.mean(coverage)) >= LEAST_COVERAGE
        claim = f"coverage of {kind} after 4 flights is 0.9 or more on uniform tests"
        rows.append(_level(f"{preset}_coverage_{kind}", coverage, LEAST_COVERAGE, enough, claim))
    return rows


def _level(name: str, values: list[float], bound: float, fine: bool, claim: str) -> Row:
    mean = float(np.mean(values)) if values else math.nan
    return Row(f"verdict_{name}", mean, "1", f"{'holds' if fine else 'does not hold'}: {claim}", bound)
