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
    """The whole loop on a simulated arm or quadrotor that no simple model describes, in about two minutes."""

    kind: Kind = "arm"
    """Which demo: an arm that learns its commands, or a quadrotor that learns its voltages and drag."""
    folder: Path | None = None
    """Where to keep the campaign; a new folder etude-demo-N here if not given."""
    robot: str | None = None
    """Another built-in robot with a simulated plant; arm4_rough or quadrotor_rough if not given."""
    rounds: int | None = None
    """Motions to ask for, run and learn; 6 of an arm or 4 flights if not given."""
    seed: int = 0
    """Of every random number."""

    def run(self, say: Say) -> Outcome:
        from etude.cli.demonstration import run

        text, data = run(self.folder, self.kind, self.robot, self.rounds, self.seed, say)
        return Outcome(text, data)
