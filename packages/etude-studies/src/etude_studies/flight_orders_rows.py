"""The rows of `etude study quadrotor`: levels of every arm, and paired ratios with 95 % intervals.

A ratio is the baseline's figure over the arm's, so that above 1 the arm is better; the geometric mean over
seeds, with the t-interval of its logarithm.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from etude_studies.flight_orders_cell import BASELINES, CRITERIA
from etude_studies.paired import Paired, paired
from etude_studies.rows import Row, mean_rows

Cells = Sequence[Mapping[str, Any]]

TESTS = ("uniform", "boundary", "extremes")
RANDOM = "uniform"
"""The arm that "random" means where nothing else is said."""
KINDS = ("gp", "identified", "nominal", "ladder")
DEVIATIONS = {"sd": "latent_common", "sd_in_use": "latent"}
"""Predicted deviation over the reference states: under hyperparameters common to all arms, and as in use."""


def last_count(cells: Cells) -> int:
    """Flights that every arm has flown."""
    return min(max(int(n) for n in rounds) for cell in cells for rounds in cell["measured"].values())


def arms_of(cells: Cells) -> tuple[str, ...]:
    """Arms of the study, in their order."""
    return tuple(cells[0]["measured"])


def figures(
    cells: Cells, arm: str, count: int, test: str, figure: str = "mae", kind: str = "gp"
) -> list[float]:
    """One figure of every seed; NaN where there is none."""
    values = [cell["measured"][arm][str(count)]["tests"][test][kind][figure] for cell in cells]
    return [math.nan if value is None else float(value) for value in values]


def deviations(cells: Cells, arm: str, count: int, name: str) -> list[float]:
    """Predicted deviation over the reference states of every seed, V; `name` is a key of `DEVIATIONS`."""
    return [cell["measured"][arm][str(count)]["reference"][DEVIATIONS[name]] for cell in cells]


def compare(
    cells: Cells,
    arm: str,
    baseline: str,
    test: str,
    count: int | None = None,
    figure: str = "mae",
    kind: str = "gp",
) -> Paired:
    """How many times lower a figure of an arm's model, by default its process, is than the baseline's."""
    count = last_count(cells) if count is None else count
    design, other = (figures(cells, name, count, test, figure, kind) for name in (arm, baseline))
    return paired(other, design)


def compare_deviation(cells: Cells, arm: str, name: str = "sd", count: int | None = None) -> Paired:
    """How many times lower an arm's predicted deviation over the reference states is than random's."""
    count = last_count(cells) if count is None else count
    return paired(deviations(cells, RANDOM, count, name), deviations(cells, arm, count, name))


def order_rows(preset: str, cells: Cells) -> list[Row]:
    """Levels, then ratios, of one preset."""
    rows = [row for arm in arms_of(cells) for row in _levels(preset, cells, arm)]
    for arm in arms_of(cells):
        if arm in CRITERIA:
            rows += _ratios(preset, cells, arm)
    return rows + mean_rows(f"{preset}_cpu_s", [cell["cpu_s"] for cell in cells], "s", "of one seed", [])


def ratio_rows(metric: str, ratio: Paired, against: str) -> list[Row]:
    """A ratio and the ends of its interval."""
    rows = [Row(metric, ratio.ratio, "1", f"{against}, {ratio.words}", 1.0)]
    if ratio.count > 1:
        rows += [Row(f"{metric}_low", ratio.low, "1"), Row(f"{metric}_high", ratio.high, "1")]
    return rows


def _levels(preset: str, cells: Cells, arm: str) -> list[Row]:
    """Error of the process after every flight, then all kinds and their calibration after the last one."""
    rows, last = [], last_count(cells)
    for count in sorted(int(n) for n in cells[0]["measured"][arm]):
        for test in TESTS:
            nominal = figures(cells, arm, count, test, "mae", "nominal")
            name = f"{preset}_{arm}_{count}_mae_{test}"
            rows += mean_rows(name, figures(cells, arm, count, test), "V", "nominal", nominal)
        for name in DEVIATIONS:
            metric = f"{preset}_{arm}_{count}_{name}"
            rows += mean_rows(metric, deviations(cells, arm, count, name), "V", "reference states", [])
    for test in TESTS:
        late = figures(cells, arm, last, test, "mae_after")
        rows += mean_rows(f"{preset}_{arm}_{last}_mae_after_{test}", late, "V", "after 5 s", [])
        for kind in KINDS[1:]:
            errors = figures(cells, arm, last, test, "mae", kind)
            process = figures(cells, arm, last, test)
            rows += mean_rows(f"{preset}_{arm}_{last}_mae_{kind}_{test}", errors, "V", "gp", process)
        for kind in ("gp", "ladder"):
            rows += _calibration(f"{preset}_{arm}_{last}", cells, (arm, last, test), kind)
    speeds = [float(np.mean(cell["speed"][arm][1:])) for cell in cells]
    return rows + mean_rows(f"{preset}_{arm}_speed", speeds, "m/s", "mean of the chosen flights", [])


def _calibration(name: str, cells: Cells, place: tuple[str, int, str], kind: str) -> list[Row]:
    aims = {
        "z2": ("1", "calibrated", [1.0]),
        "coverage": ("1", "nominal", [0.95]),
        "nlpd": ("nat", "", []),
        "nlpd_t": ("nat", "", []),
    }
    rows = []
    for figure, (unit, label, aim) in aims.items():
        metric = f"{name}_{figure}_{kind}_{place[2]}"
        values = [v for v in figures(cells, *place, figure, kind) if math.isfinite(v)]
        rows += mean_rows(metric, values, unit, label, aim)
    return rows


def _ratios(preset: str, cells: Cells, arm: str) -> list[Row]:
    """One criterion against every baseline on every test set, and its predicted deviation."""
    rows = []
    for baseline in (option for option in BASELINES if option in arms_of(cells)):
        name = f"{preset}_{arm}_vs_{'random' if baseline == RANDOM else baseline}"
        for figure in ("mae", "mae_after"):
            for test in TESTS:
                ratio = compare(cells, arm, baseline, test, figure=figure)
                rows += ratio_rows(f"{name}_{figure}_{test}", ratio, f"{baseline} random over it")
    for test in TESTS:
        ratio = compare(cells, arm, RANDOM, test, kind="ladder")
        rows += ratio_rows(f"{preset}_{arm}_vs_random_mae_ladder_{test}", ratio, "uniform random over it")
    for name in DEVIATIONS:
        ratio = compare_deviation(cells, arm, name)
        rows += ratio_rows(f"{preset}_{arm}_vs_random_{name}", ratio, "uniform random over it")
    return rows
