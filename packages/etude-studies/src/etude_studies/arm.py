"""etude study arm: what the README claims of the simulated arms, by whole campaigns over many seeds.

Every cell is an ordinary campaign folder, made by `create_campaign` and run by `simulate`, so that the
figures come from the product's own loop. A finished cell is skipped, a killed one goes on where it was.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

from etude.campaign import (
    CONFIG,
    JOURNAL,
    CampaignConfig,
    config_text,
    create_campaign,
    load_config,
    open_campaign,
    simulate,
)
from etude.errors import UsageError
from etude.models import Structure
from etude.storage import write_atomic
from etude_studies.arm_rows import arm_rows
from etude_studies.engines.each import each
from etude_studies.rows import rows_json, table

ROUNDS = 6


@dataclass(frozen=True)
class Cell:
    """One campaign of the study.

    Attributes:
        robot: a built-in simulated robot.
        rung: `model.rung` in campaign.toml; everything else is the default preset.
        seed: of the campaign.
    """

    robot: str
    rung: Structure | Literal["auto"]
    seed: int

    @property
    def name(self) -> str:
        return f"{self.robot}_{self.rung}_{self.seed:04d}"


ARMS: tuple[tuple[str, Structure | Literal["auto"]], ...] = (
    ("arm4", "gp"),
    ("arm4", "identified+gp"),
    ("arm4_rough", "gp"),
    ("arm4_rough", "auto"),
)


def run(*, json: bool, seed: int, seeds: int, folder: Path) -> None:
    """Runs seeds `seed` .. `seed + seeds - 1` of every arm and prints the rows.

    Raises:
        UsageError: fewer than two seeds, of which no interval can be made.
    """
    if seeds < 2:
        raise UsageError(f"an interval needs 2 seeds or more, not {seeds}")
    cells = [Cell(*arm, s) for arm in ARMS for s in range(seed, seed + seeds)]
    for done, cell in enumerate(_run_all(cells, folder), start=1):
        _say(f"{done} of {len(cells)} campaigns: {cell.name}")
    rows = arm_rows(folder, cells)
    if json:
        print(rows_json(rows, f"etude study arm --seed {seed} --seeds {seeds}"))  # noqa: T201
    else:
        table(rows, f"simulated arms, {seeds} seeds from {seed}")


def _say(text: str) -> None:
    from rich.console import Console

    Console(stderr=True).print(text, highlight=False)


def _run_all(cells: list[Cell], folder: Path) -> Iterator[Cell]:
    return each(partial(run_one, folder=folder), cells)


def run_one(cell: Cell, folder: Path) -> Cell:
    """Runs one campaign up to its last round; a finished one costs nothing."""
    run_campaign(folder / cell.name, cell.robot, cell.seed, lambda c: _of_rung(c, cell.rung))
    return cell


def _of_rung(config: CampaignConfig, rung: Structure | Literal["auto"]) -> CampaignConfig:
    return replace(config, model=replace(config.model, rung=rung))


def run_campaign(
    path: Path,
    robot: str,
    seed: int,
    chosen: Callable[[CampaignConfig], CampaignConfig],
    *,
    feedforward: bool = False,
) -> None:
    """A campaign of ROUNDS of the default preset but for what is `chosen`; goes on where it was."""
    if not (path / JOURNAL).exists():
        create_campaign(path, robot, seed=seed)
    loaded = load_config(path)
    if chosen(loaded.config) != loaded.config:
        write_atomic(path / CONFIG, config_text(chosen(loaded.config), loaded.kind).encode())
    campaign = open_campaign(path)
    for _ in simulate(campaign, ROUNDS - len(campaign.state().trained), feedforward=feedforward):
        pass
