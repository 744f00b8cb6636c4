"""etude study"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro

from etude.commands.common import Common
from etude.commands.outcome import Outcome, Say


@dataclass(frozen=True, kw_only=True)
class Study(Common):
    """Run a study: seeds, intervals and a verdict beside the published figure."""

    name: Annotated[str, tyro.conf.Positional]
    """Which one; an unknown name lists them."""

    seed: int = 0
    """Of every random number."""

    def run(self, _: Say) -> Outcome:
        from etude.studies.registry import run_study

        run_study(self.name, json=self.json, seed=self.seed)
        return Outcome("")
