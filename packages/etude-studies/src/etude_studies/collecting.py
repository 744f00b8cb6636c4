"""Comparison of motions that run under feedback alone with motions that run with the learned command.

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

from etude.campaign import Campaign, CampaignConfig, open_campaign
from etude_studies.arm import run_campaign
from etude_studies.arm_rows import TESTS, tracking_errors
from etude_studies.engines.each import each
from etude_studies.paired import paired

ROBOTS = ("arm4", "arm4_rough")
MANNERS = ("feedback", "feedforward", "all teach")
SHOWN = (2, 4, 6)
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
    chosen = _all_teach if cell.manner == MANNERS[2] else _as_it_is
    alone = cell.manner == MANNERS[0]
    run_campaign(folder / cell.name, cell.robot, cell.seed, chosen, feedforward=not alone)
    return cell


def _as_it_is(config: CampaignConfig) -> CampaignConfig:
    return config


def _all_teach(config: CampaignConfig) -> CampaignConfig:
    data: Any = config.data
    return replace(config, data=replace(data, reversal=0.0))


def collected(campaign: Campaign) -> float:
    """Largest position error of any joint in the motions from the second on, degrees."""
    tracked = [r.ingested.tracked for r in campaign.state().ingested[1:] if r.ingested]
    return float(
        np.degrees(
            max(np.max(np.array(table[0], dtype=float)) for by_form in tracked for table in by_form.values())
        )
    )


def table(folder: Path, seeds: Sequence[int]) -> str:
    """A line of Markdown for each robot, manner and test."""
    lines = ["| robot | with | test | after 2 | after 4 | after 6 | largest error while it taught, median |"]
    lines.append("|---|---|---|---|---|---|---|")
    for robot in ROBOTS:
        for manner in MANNERS:
            campaigns = [open_campaign(folder / Cell(robot, manner, s).name) for s in seeds]
            alone = [open_campaign(folder / Cell(robot, MANNERS[0], s).name) for s in seeds]
            largest = float(np.median([collected(campaign) for campaign in campaigns]))
            for test in TESTS:
                cells = [
                    _cell(
                        tracking_errors(campaigns, test, "", k), tracking_errors(alone, test, "", k), manner
                    )
                    for k in SHOWN
                ]
                lines.append(f"| `{robot}` | {manner} | {test} | {' | '.join(cells)} | {largest:.1f} deg |")
    return "\n".join(lines)


def _cell(mine: Sequence[float], theirs: Sequence[float], manner: str) -> str:
    mean = f"{np.mean(mine):.3f}"
    if manner == MANNERS[0]:
        return mean
    ratio = paired(mine, theirs)
    return f"{mean}: {ratio.ratio:.2f} ({ratio.low:.2f} to {ratio.high:.2f})"


def main(folder: Path, first: int = FIRST, seeds: int = SEEDS) -> None:
    """Runs what is missing and prints the table."""
    every = range(first, first + seeds)
    cells = [Cell(robot, manner, seed) for seed in every for robot in ROBOTS for manner in MANNERS]
    for done, cell in enumerate(each(partial(run_one, folder=folder), cells), start=1):
        print(f"{done} of {len(cells)}: {cell.name}", file=sys.stderr)  # noqa: T201
    print(table(folder, every))  # noqa: T201


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
