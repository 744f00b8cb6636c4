"""etude bench"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from etude.commands.common import Common
from etude.commands.outcome import Outcome, Say
from etude.commands.studies import run_study


@dataclass(frozen=True, kw_only=True)
class Bench(Common):
    """Measure a part of Étude against what its machine can do at best."""

    name: Annotated[str, tyro.conf.Positional]
    """Which one; an unknown name lists them."""

    seed: int = 0
    """Of every random number."""

    quick: bool = False
    """Fewer seeds, where a bench has several: all figures of `models` within three minutes. In `gp` the other
    libraries only up to n = 1000."""

    python: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """The interpreter of another environment, for libraries that `gp` compares with and that are not in this
    one; can be given several times. They are timed in a process of their own."""

    logs: Path | None = None
    """Folder with recordings that are not part of the project, for `models`, `truth`, `changed`
    and `watch`: docs/real_logs.md."""

    def run(self, _: Say) -> Outcome:
        options = {"json": self.json, "seed": self.seed}
        optional = {"quick": self.quick, "pythons": self.python, "logs": self.logs}
        run_study("bench", self.name, options, optional)
        return Outcome("")
