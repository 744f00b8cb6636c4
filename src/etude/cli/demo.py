"""etude demo"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from etude.cli.outcome import Common, Outcome, Say

Kind = Annotated[Literal["arm", "quadrotor"], tyro.conf.Positional, tyro.conf.arg(metavar="arm|quadrotor")]


@dataclass(frozen=True, kw_only=True)
class Demo(Common):
    """Run the whole loop on a simulated arm or quadrotor that no simple model describes, in about two
    minutes."""

    kind: Kind = "arm"
    """Which demo: an arm that learns its commands, or a quadrotor that learns its voltages and drag."""
    folder: Path | None = None
    """Folder of the campaign. Default: a new folder etude-demo-N here."""
    robot: str | None = None
    """Another built-in robot with a simulated plant. Default: arm4_rough or quadrotor_rough."""
    rounds: int | None = None
    """Number of motions to plan, run and learn. Default: 6 motions of the arm, or 4 flights."""
    seed: int = 0
    """Seed of all random numbers."""

    def run(self, say: Say) -> Outcome:
        from etude.cli.demonstration import run

        text, data = run(self.folder, self.kind, self.robot, self.rounds, self.seed, say)
        return Outcome(text, data)
