"""etude init"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from etude.commands.common import Common, Folder
from etude.commands.outcome import Outcome, Say


@dataclass(frozen=True, kw_only=True)
class Init(Common):
    """Start a campaign: a folder that holds the robot, the configuration and everything to come."""

    folder: Folder
    robot: str
    """A built-in robot's name, or the path of a robot TOML, URDF or MJCF; copied into the folder."""
    preset: Literal["default", "thesis"] = "default"
    """The configuration to start from; written out in full in campaign.toml."""
    seed: int = 0
    """Of every random number the campaign draws."""

    def run(self, _: Say) -> Outcome:
        from etude.campaign.create import create_campaign
        from etude.errors import UsageError

        if self.seed < 0:
            raise UsageError(f"the seed must be 0 or more, not {self.seed}")
        campaign, confirm = create_campaign(self.folder, self.robot, self.preset, self.seed)
        spec = campaign.spec
        what = f"{spec.dof} axes ({', '.join(spec.names)})"
        if spec.flight is not None:
            what = f"flies in x, y, z; commands {', '.join(spec.outputs)}"
        lines = [f"Campaign {self.folder} for {spec.name}: {what}."]
        if confirm:
            lines += ["Please confirm in robot.toml:", *(f"  - {sentence}" for sentence in confirm)]
        lines.append(f"Next: etude ask {self.folder}, or etude tell {self.folder} LOG if you have one.")
        data = {"folder": str(self.folder), "robot": spec.name, "axes": spec.names, "confirm": confirm}
        return Outcome("\n".join(lines), {**data, "preset": self.preset, "seed": self.seed})
