"""etude export"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from etude.commands.common import Common, Folder, opened
from etude.commands.outcome import Outcome, Say


@dataclass(frozen=True, kw_only=True)
class Export(Common):
    """Write the model as what another program runs: C99 for a controller's loop, and what etude plugins
    lists under etude.targets."""

    folder: Folder
    to: str
    """For whom: c, or another target."""
    output: Path | None = None
    """Folder to write; exports/TARGET in the campaign's by default. An earlier export there is replaced."""
    real: Literal["double", "float"] | None = None
    """c: type of its numbers; float is refused where it would be wrong."""
    variance: bool = False
    """c: with the variance of each command beside the mean."""
    fade: bool = False
    """c: with a command that fades to physics, or zero, where the model knows little; takes variances."""
    single: bool = False
    """c: the best candidate of each command alone where several are averaged."""
    rate: float | None = None
    """c: Hz at which it will be called; warns where the worst case takes longer."""
    name: str = ""
    """c: prefix of files and functions; the robot's name by default."""
    more: Annotated[tuple[str, ...], tyro.conf.arg(name="set", metavar="NAME=VALUE")] = ()
    """An option of another package's target."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.model_export import export, given

        campaign = opened(self.folder, say)
        options = given(
            real=self.real,
            variance=self.variance,
            fade=self.fade,
            single=self.single,
            rate=self.rate,
            name=self.name,
            more=self.more,
        )
        found = export(campaign, self.to, self.output, **options)
        lines = [*found.said, "Written:", *(f"  {found.folder / name}" for name in found.files)]
        data = {"target": found.target, "folder": str(found.folder), "files": list(found.files)}
        return Outcome("\n".join(lines), {**data, **found.facts})
