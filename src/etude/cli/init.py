"""etude init"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from etude.cli.outcome import TRUSTED, Common, Folder, Outcome, Say
from etude.errors import typed

if TYPE_CHECKING:
    from etude.campaign.record.folder import Campaign


HOLD = "--hold", "joint=position", "finger=0.02"
ACCELERATION = "--acceleration", "joint=limit", "wrist=4.2"
VELOCITY = "--velocity", "joint=limit", "wrist=2.1"
COMMAND = "--command", "joint=limit", "wrist=40"


@dataclass(frozen=True, kw_only=True)
class Init(Common):
    """Start a campaign: a folder for the robot's description, the configuration, trajectories, logs and
    models."""

    folder: Folder
    robot: str
    """Name of a built-in robot, or the file that describes the robot (TOML, URDF, MJCF). It is copied into
    the folder."""
    preset: str = "default"
    """Configuration to start from: default or thesis. campaign.toml lists all its values."""
    seed: int = 0
    """Seed of all random numbers of the campaign."""

    joints: tuple[str, ...] = ()
    """Joints that move, by name or pattern such as "arm_*" (URDF, MJCF). The others are fixed."""
    hold: tuple[str, ...] = ()
    """Positions of the fixed joints, joint=position in rad or m. Default: 0, or the limit nearest to 0."""
    range: tuple[str, ...] = ()
    """Position limits, joint=lower:upper in rad or m: for joints that turn without end, or tighter than in
    the file."""
    velocity: tuple[str, ...] = ()
    """Velocity limits, joint=limit in rad/s or m/s ("*=2.1" for all), in place of the file's. MJCF files have
    none."""
    acceleration: tuple[str, ...] = ()
    """Acceleration limits, joint=limit in rad/s^2 or m/s^2 ("*=4" for all), in place of the file's. Few files
    have any."""
    command: tuple[str, ...] = ()
    """Command limits, joint=limit in N m or N ("*=40" for all), in place of the file's."""
    joint_limits: Path | None = None
    """MoveIt's joint_limits.yaml. Its limits are used where the file has none or looser ones."""
    floor: float | None = None
    """Height of the floor in m above the base. Default: that of the model file, else 0."""
    mesh_root: tuple[Path, ...] = ()
    """Folders to search for meshes first, with or without the package's name."""

    def trust_files(self) -> None:
        """Nothing: `run` trusts the robot's file and the folder once the campaign is made."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.create import RobotPart, create_campaign, trust_robot
        from etude.errors import UsageError

        if self.seed < 0:
            raise UsageError(f"the seed must be 0 or more, not {self.seed}")
        part = RobotPart(
            _split(self.joints),
            _numbers(self.hold, HOLD),
            self.mesh_root,
            self._limits(),
            self.floor,
            self.joint_limits,
        )
        campaign, confirm = create_campaign(
            self.folder, self.robot, self.preset, self.seed, part, trust=self.trust
        )
        if self.trust:
            trust_robot(self.robot)
            say(TRUSTED.format(self.robot))
        lines = [f"Campaign {self.folder} for {campaign.name}: {_axes_sentence(campaign)}."]
        if confirm:
            lines += [
                "Please check these assumptions, then remove their lines from confirm in robot.toml:",
                *(f"  - {sentence}" for sentence in confirm),
            ]
        lines.append(
            f"Next: etude ask {typed(self.folder)}, or etude tell {typed(self.folder)} LOG if you have one."
        )
        data = {"folder": str(self.folder), "robot": campaign.name, "axes": campaign.axes, "confirm": confirm}
        return Outcome("\n".join(lines), {**data, "preset": self.preset, "seed": self.seed})

    def _limits(self) -> dict[str, dict[str, float]]:
        """Limits by joint or pattern, which replace those of the robot's file."""
        limits: dict[str, dict[str, float]] = {}
        for joint, (low, high) in _ranges(self.range).items():
            limits[joint] = {"lower": low, "upper": high}
        for name, entries, form in (
            ("velocity", self.velocity, VELOCITY),
            ("acceleration", self.acceleration, ACCELERATION),
            ("command", self.command, COMMAND),
        ):
            for joint, value in _numbers(entries, form).items():
                limits.setdefault(joint, {})[name] = value
        return limits


def _split(entries: tuple[str, ...]) -> tuple[str, ...]:
    """Entries, separated by commas or given one by one."""
    return tuple(word for one in entries for word in one.split(",") if word)


def _numbers(entries: tuple[str, ...], form: tuple[str, str, str]) -> dict[str, float]:
    """Numbers by joint, from joint=number. UsageError: an entry is invalid; `form` has option and example."""
    from etude.errors import UsageError

    numbers, (option, expected, example) = {}, form
    for one in _split(entries):
        joint, _, number = one.rpartition("=")
        try:
            numbers[joint] = float(number)
        except ValueError:
            joint = ""
        if not joint:
            raise UsageError(
                f"{one!r} does not have the form {expected}",
                where=option,
                next_step=f"Write {option} {example}.",
            )
    return numbers


def _ranges(entries: tuple[str, ...]) -> dict[str, tuple[float, float]]:
    """Ranges by joint, from joint=lower:upper. UsageError: an entry is invalid."""
    from etude.errors import UsageError

    ranges = {}
    for one in _split(entries):
        joint, _, ends = one.rpartition("=")
        try:
            low, high = (float(end) for end in ends.split(":"))
        except ValueError:
            joint, low, high = "", 0.0, 0.0
        if not joint or not low < high:
            raise UsageError(
                f"{one!r} does not have the form joint=lower:upper",
                where="--range",
                next_step="Write --range wrist=-3.1:3.1.",
            )
        ranges[joint] = (low, high)
    return ranges


def _axes_sentence(campaign: Campaign) -> str:
    """Sentence on the axes, and on the commands if they have other names."""
    axes, commands = campaign.axes, campaign.command.parts
    what = f"{len(axes)} axes ({', '.join(axes)})"
    return what if axes == commands else f"{what}; commands {', '.join(commands)}"
