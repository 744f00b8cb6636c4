"""etude bench"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from etude.commands.common import Common
from etude.commands.outcome import Outcome, Say


@dataclass(frozen=True, kw_only=True)
class Bench(Common):
    """Measure a part of Étude against what its machine can do at best."""

    name: Annotated[str, tyro.conf.Positional]
    """Which one; an unknown name lists them."""

    seed: int = 0
    """Of every random number."""

    quick: bool = False
    """Fewer seeds, where a bench has several: all figures of `models` within three minutes."""

    logs: Path | None = None
    """Folder with recordings that are not part of the project, for `models`: docs/real_logs.md."""

    def run(self, _: Say) -> Outcome:
        from etude.studies.registry import run_bench

        run_bench(self.name, json=self.json, seed=self.seed, quick=self.quick, logs=self.logs)
        return Outcome("")
