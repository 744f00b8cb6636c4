"""etude demo"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from etude.commands.common import Common
from etude.commands.outcome import Outcome, Say


@dataclass(frozen=True, kw_only=True)
class Demo(Common):
    """The whole loop on a simulated arm that no rigid-body model describes, in about a minute."""

    folder: Path | None = None
    """Where to keep the campaign; a new folder etude-demo-N here if not given."""
    robot: str = "arm4_rough"
    """A built-in robot with a simulated plant."""
    rounds: int = 6
    """Trajectories to ask for, run and learn."""
    seed: int = 0
    """Of every random number."""

    def run(self, say: Say) -> Outcome:
        from etude.studies.demo import run

        text, data = run(self.folder, self.robot, self.rounds, self.seed, say)
        return Outcome(text, data)
