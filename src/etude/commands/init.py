"""etude init"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from etude.commands.common import Common, Folder
from etude.commands.outcome import Outcome, Say

if TYPE_CHECKING:
    from etude.campaign.folder import Campaign


@dataclass(frozen=True, kw_only=True)
class Init(Common):
    """Start a campaign: a folder that holds the robot, the configuration and everything to come."""

    folder: Folder
    robot: str
    """A built-in robot's name, or the file that describes it (TOML, URDF, MJCF); copied into the folder."""
    preset: str = "default"
    """The configuration to start from, "default" or "thesis"; written out in full in campaign.toml."""
    seed: int = 0
    """Of every random number the campaign draws."""

    def run(self, _: Say) -> Outcome:
        from etude.campaign.create import create_campaign
        from etude.errors import UsageError

        if self.seed < 0:
            raise UsageError(f"the seed must be 0 or more, not {self.seed}")
        campaign, confirm = create_campaign(self.folder, self.robot, self.preset, self.seed)
        lines = [f"Campaign {self.folder} for {campaign.name}: {_moves(campaign)}."]
        if confirm:
            lines += ["Please confirm in robot.toml:", *(f"  - {sentence}" for sentence in confirm)]
        lines.append(f"Next: etude ask {self.folder}, or etude tell {self.folder} LOG if you have one.")
        data = {"folder": str(self.folder), "robot": campaign.name, "axes": campaign.axes, "confirm": confirm}
        return Outcome("\n".join(lines), {**data, "preset": self.preset, "seed": self.seed})


def _moves(campaign: Campaign) -> str:
    """What moves, and what is commanded where that is something else."""
    axes, commands = campaign.axes, campaign.command.parts
    what = f"{len(axes)} axes ({', '.join(axes)})"
    return what if axes == commands else f"{what}; commands {', '.join(commands)}"
