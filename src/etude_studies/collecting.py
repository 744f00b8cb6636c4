"""What motions teach that are run under feedback alone, or with what was learned so far beside it.

    python -m etude_studies.collecting FOLDER [FIRST_SEED SEEDS]

Whole campaigns of six trajectories, made by `create_campaign` and run by `simulate`; a finished one is
skipped. "all teach" is the feedforward without `reversal`: samples near fast reversals teach too. Prints mean
tracking errors in degrees, the geometric mean of the ratios to feedback alone over paired seeds with its 95 %
interval, and the median over seeds of the largest position error while collecting.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student

from etude.campaign.config_file import CONFIG, config_text, load_config
from etude.campaign.create import create_campaign
from etude.campaign.folder import Campaign, open_campaign
from etude.campaign.journal import JOURNAL
from etude.campaign.rounds import measured
from etude.campaign.simulate import simulate
from etude.contracts import Array
from etude.storage import write_atomic
from etude_studies.arm_rows import TESTS
from etude_studies.engines.each import each

ROBOTS = ("arm4", "arm4_rough")
MANNERS = ("feedback", "feedforward", "all teach")
ROUNDS, SHOWN = 6, (2, 4, 6)
FIRST, SEEDS = 2000, 6
"""Seeds that served for nothing else: the mask was settled on those from 1000."""


@dataclass(frozen=True)
class Cell:
    """One campaign of the study."""

    robot: str
    manner: str
    seed: int

    @property
    def name(self) -> str:
        return f"{self.robot}_{self.manner.replace(' ', '_')}_{self.seed:04d}"


def run_one(cell: Cell, folder: Path) -> Cell:
    """Runs one campaign up to its last round; a finished one costs nothing."""
    path = folder / cell.name
    if not (path / JOURNAL).exists():
        create_campaign(path, cell.robot, seed=cell.seed)
    if cell.manner == MANNERS[2]:
        found = load_config(path)
        data: Any = replace(found.config.data, reversal=0.0)
        write_atomic(path / CONFIG, config_text(replace(found.config, data=data), found.kind).encode())
    campaign = open_campaign(path)
    left = ROUNDS - len(campaign.state().trained)
    for _ in simulate(campaign, left, feedforward=cell.manner != MANNERS[0]):
        pass
    return cell


def errors(campaign: Campaign, test: str) -> Array:
    """(ROUNDS,) mean over joints, of the learned model after each round."""
    found = np.full(ROUNDS, np.nan)
    for event in campaign.state().evaluated:
        if event["test"] == test and not event.get("baseline") and event["number"] <= ROUNDS:
            found[event["number"] - 1] = np.mean(measured(event)[0])
    return found


def collected(campaign: Campaign) -> float:
    """Largest position error of any joint in the motions from the second on, degrees."""
    told = [(r.told or {})["tracked"] for r in campaign.state().told[1:]]
    return float(np.degrees(max(np.max(table[0]) for by_form in told for table in by_form.values())))


def table(folder: Path, seeds: Sequence[int]) -> str:
    """A line of Markdown for each robot, manner and test."""
    lines = ["| robot | with | test | after 2 | after 4 | after 6 | largest error while it taught, median |"]
    lines.append("|---|---|---|---|---|---|---|")
    for robot in ROBOTS:
        for manner in MANNERS:
            own = [open_campaign(folder / Cell(robot, manner, s).name) for s in seeds]
            alone = [open_campaign(folder / Cell(robot, MANNERS[0], s).name) for s in seeds]
            largest = float(np.median([collected(campaign) for campaign in own]))
            for test in TESTS:
                mine, theirs = (np.array([errors(c, test) for c in many]) for many in (own, alone))
                cells = [_cell(mine[:, k - 1], theirs[:, k - 1], manner) for k in SHOWN]
                lines.append(f"| `{robot}` | {manner} | {test} | {' | '.join(cells)} | {largest:.1f} deg |")
    return "\n".join(lines)


def _cell(mine: Array, theirs: Array, manner: str) -> str:
    if manner == MANNERS[0]:
        return f"{mine.mean():.3f}"
    ratios = np.log(mine / theirs)
    half = student.ppf(0.975, len(ratios) - 1) * ratios.std(ddof=1) / np.sqrt(len(ratios))
    low, middle, high = np.exp(ratios.mean() + half * np.array([-1.0, 0.0, 1.0]))
    return f"{mine.mean():.3f}: {middle:.2f} ({low:.2f} to {high:.2f})"


def main(folder: Path, first: int = FIRST, seeds: int = SEEDS) -> None:
    """Runs what is missing and prints the table."""
    every = range(first, first + seeds)
    cells = [Cell(robot, manner, seed) for seed in every for robot in ROBOTS for manner in MANNERS]
    for done, cell in enumerate(each(partial(run_one, folder=folder), cells), start=1):
        print(f"{done} of {len(cells)}: {cell.name}", file=sys.stderr)  # noqa: T201
    print(table(folder, every))  # noqa: T201


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
