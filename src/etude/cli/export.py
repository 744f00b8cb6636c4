"""etude export"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from etude.cli.outcome import Common, Folder, Outcome, Say, opened


@dataclass(frozen=True, kw_only=True)
class Export(Common):
    """Write the model as what another program runs: C99 for a controller's loop, a controller for ROS 2, an
    addition to PX4 or a Crazyflie, a trajectory with commands, ONNX."""

    folder: Folder
    to: str
    """For whom: c, ros2, px4, crazyflie, trajectory, onnx, urdf, or another target of etude plugins."""
    output: Path | None = None
    """Folder to write; exports/TARGET in the campaign's by default. An earlier export there is replaced."""
    real: Literal["double", "float"] | None = None
    """c, onnx: type of its numbers; float is refused where it would be wrong."""
    variance: bool = False
    """c, onnx: with the variance of each command beside the mean."""
    fade: bool = True
    """c, ros2, onnx: commands fade to physics, or a level, where the model knows no more than before any
    data, as `etude predict` does; this takes variances. --no-fade: the mean given the data everywhere.
    """
    single: bool = False
    """In C: the best candidate of each command alone where several are averaged."""
    rate: float | None = None
    """In C: Hz at which it will be called; warns where the worst case takes longer. trajectory: of its
    table."""
    name: str = ""
    """Prefix of files and functions; the robot's name by default."""
    more: Annotated[tuple[str, ...], tyro.conf.arg(name="set", metavar="NAME=VALUE")] = ()
    """More of a target: motion or format of trajectory, interface of ros2; those of other packages'
    targets."""

    def run(self, _: Say) -> Outcome:
        from etude.campaign.deployment.model_export import export, given

        campaign = opened(self.folder)
        options = given(
            real=self.real,
            variance=self.variance,
            single=self.single,
            rate=self.rate,
            name=self.name,
            more=self.more,
        )
        if not self.fade:
            options["fade"] = False
        found = export(campaign, self.to, self.output, **options)
        lines = [*found.said, "Written:", *(f"  {found.folder / name}" for name in found.files)]
        data = {"target": found.target, "folder": str(found.folder), "files": list(found.files)}
        return Outcome("\n".join(lines), {**data, **found.facts})
