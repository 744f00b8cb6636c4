"""etude init"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
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

    joints: tuple[str, ...] = ()
    """Of a URDF or MJCF: the joints that move, by name or pattern ("arm_*"); the others are held."""
    hold: tuple[str, ...] = ()
    """Where others are held, joint=position in rad or m; at 0, or their limit next to it, if not said."""
    range: tuple[str, ...] = ()
    """How far joints may go, joint=lower:upper in rad or m: of joints that turn without end, or less than the
    file allows."""
    mesh_root: tuple[Path, ...] = ()
    """Folders to look for meshes in first, with their package's name or without."""

    def run(self, _: Say) -> Outcome:
        from etude.campaign.create import Part, create_campaign
        from etude.errors import UsageError

        if self.seed < 0:
            raise UsageError(f"the seed must be 0 or more, not {self.seed}")
        part = Part(self.joints, _positions(self.hold), self.mesh_root, _ranges(self.range))
        campaign, confirm = create_campaign(self.folder, self.robot, self.preset, self.seed, part)
        lines = [f"Campaign {self.folder} for {campaign.name}: {_moves(campaign)}."]
        if confirm:
            lines += [
                "Please confirm, and take out of confirm in robot.toml:",
                *(f"  - {sentence}" for sentence in confirm),
            ]
        lines.append(f"Next: etude ask {self.folder}, or etude tell {self.folder} LOG if you have one.")
        data = {"folder": str(self.folder), "robot": campaign.name, "axes": campaign.axes, "confirm": confirm}
        return Outcome("\n".join(lines), {**data, "preset": self.preset, "seed": self.seed})


def _positions(held: tuple[str, ...]) -> dict[str, float]:
    """Positions by joint of joint=position. UsageError if one is no such thing."""
    from etude.errors import UsageError

    found = {}
    for one in held:
        joint, _, position = one.rpartition("=")
        try:
            found[joint] = float(position)
        except ValueError:
            joint = ""
        if not joint:
            raise UsageError(
                f"{one!r} is no joint=position", where="--hold", next_step="Write --hold finger=0.02."
            )
    return found


def _ranges(given: tuple[str, ...]) -> dict[str, tuple[float, float]]:
    """Ends by joint of joint=lower:upper. UsageError if one is no such thing."""
    from etude.errors import UsageError

    found = {}
    for one in given:
        joint, _, ends = one.rpartition("=")
        try:
            low, high = (float(end) for end in ends.split(":"))
        except ValueError:
            joint, low, high = "", 0.0, 0.0
        if not joint or not low < high:
            raise UsageError(
                f"{one!r} is no joint=lower:upper", where="--range", next_step="Write --range wrist=-3.1:3.1."
            )
        found[joint] = (low, high)
    return found


def _moves(campaign: Campaign) -> str:
    """What moves, and what is commanded where that is something else."""
    axes, commands = campaign.axes, campaign.command.parts
    what = f"{len(axes)} axes ({', '.join(axes)})"
    return what if axes == commands else f"{what}; commands {', '.join(commands)}"
