"""etude study"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from etude.commands.common import Common
from etude.commands.outcome import Outcome, Say
from etude.commands.studies import run_study


@dataclass(frozen=True, kw_only=True)
class Study(Common):
    """Run a study: seeds, intervals and a verdict beside the published figure."""

    name: Annotated[str, tyro.conf.Positional]
    """Which one; an unknown name lists them."""

    seed: int = 0
    """The first seed."""

    seeds: int = 4
    """How many seeds, counted from the first."""

    folder: Path = Path("results")
    """Where campaigns are kept; a study that was interrupted goes on from there."""

    def run(self, _: Say) -> Outcome:
        options = {"json": self.json, "seed": self.seed, "seeds": self.seeds}
        run_study("study", self.name, options, {}, folder=self.folder / self.name)
        return Outcome("")
