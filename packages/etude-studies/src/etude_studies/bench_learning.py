"""`etude bench learning`: the rough arm's error after six motions of a minute each, over fresh seeds.

A campaign is simulated as `etude simulate` does it: the learned command runs from the second motion on, and
all margins hold. Each variant changes keys of [data] of campaign.toml on the same seeds. Campaigns that were
simulated are files in results/learning and are not simulated again, so a run goes on where another ended.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from etude.campaign import config_text, create_campaign, open_campaign, simulate
from etude.storage import write_atomic
from etude_studies.engines.each import each
from etude_studies.rows import Row, mean_rows, rows_json, table

FOLDER = Path("results/learning")
ROBOT = "arm4_rough"
MOTIONS, SEEDS = 6, 8
FIRST = 201
"""Of the seeds."""
BARS = {"fourier": 0.11, "moves": 0.15}
"""deg, mean over seeds, of each test."""
VARIANTS: Mapping[str, Mapping[str, Any]] = {"default": {}, "all_samples": {"reversal": 0.0}}
"""Keys of [data] that differ; the first variant is what others are compared with."""


class Curve(msgspec.Struct, frozen=True):
    """One campaign.

    Attributes:
        errors: of each test its mean error after each motion, deg.
        robot_seconds: of motion. seconds: of CPU.
    """

    errors: dict[str, list[float]]
    robot_seconds: float
    seconds: float


def run(*, json: bool = False, quick: bool = False, seed: int = 0) -> list[Row]:
    """Simulates the campaigns of `SEEDS` seeds and prints the rows; `quick`: two seeds, two motions."""
    seeds, motions = range(FIRST + seed, FIRST + seed + (2 if quick else SEEDS)), 2 if quick else MOTIONS
    cells = [(name, cell_seed) for cell_seed in seeds for name in VARIANTS]
    folder = FOLDER / f"{motions}_motions"
    curves_by_variant: dict[str, list[Curve]] = {name: [] for name in VARIANTS}
    for (name, _), curve in zip(
        cells, each(partial(kept, folder=folder, motions=motions), cells, 1), strict=True
    ):
        curves_by_variant[name].append(curve)
    rows = learning_rows(curves_by_variant)
    if json:
        print(rows_json(rows, "etude bench learning" + " --quick" * quick + " --json"))  # noqa: T201
    else:
        table(rows, f"{ROBOT} after {motions} motions, {len(seeds)} seeds")
    return rows


def kept(cell: tuple[str, int], folder: Path, motions: int) -> Curve:
    """The curve of one variant and seed, from its file if it was simulated before."""
    name, seed = cell
    path = folder / f"{name}_{seed}.json"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        write_atomic(path, msgspec.json.encode(simulated(seed, motions, VARIANTS[name])))
    return msgspec.json.decode(path.read_bytes(), type=Curve)


def simulated(seed: int, motions: int, changed: Mapping[str, Any]) -> Curve:
    """Of a campaign of its own, with these keys of [data]."""
    began = time.process_time()
    with tempfile.TemporaryDirectory() as place:
        campaign, _ = create_campaign(Path(place) / "lab", ROBOT, seed=seed)
        config = replace(campaign.config, data=replace(campaign.config.data, **changed))
        (campaign.path / "campaign.toml").write_text(config_text(config, campaign.kind), encoding="utf-8")
        rounds = list(simulate(open_campaign(campaign.path), motions))
    errors = {name: [float(np.mean(one.errors[name])) for one in rounds] for name in rounds[0].errors}
    return Curve(errors, rounds[-1].robot_seconds, time.process_time() - began)


def learning_rows(curves_by_variant: Mapping[str, Sequence[Curve]]) -> list[Row]:
    """Mean errors after the last motion with their intervals, and the mean paired difference to the first."""
    first = next(iter(curves_by_variant.values()))
    rows = []
    for name, curves in curves_by_variant.items():
        for test, bar in BARS.items():
            ends = [curve.errors[test][-1] for curve in curves]
            rows += mean_rows(f"{name}_{test}", ends, "deg", "bar", [bar])
            if curves is not first:
                apart = [end - one.errors[test][-1] for end, one in zip(ends, first, strict=True)]
                rows += mean_rows(f"{name}_{test}_more", apart, "deg", "", [])
    minutes = [curve.robot_seconds / 60.0 for curve in first]
    seconds = [curve.seconds for curves in curves_by_variant.values() for curve in curves]
    return [*rows, *mean_rows("robot_time", minutes, "min", "", []), *mean_rows("cpu", seconds, "s", "", [])]
