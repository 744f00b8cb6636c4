"""etude export, etude predict"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from etude.cli.outcome import Common, Folder, Outcome, Say, opened


@dataclass(frozen=True, kw_only=True)
class Export(Common):
    """Write the model as what another program runs: C99 for a controller's loop, a controller for ROS 2, an
    addition to PX4 or a Crazyflie, a trajectory with commands, ONNX; or what was identified, as a model file
    or a table."""

    folder: Folder
    to: str
    """For whom: c, ros2, online, px4, crazyflie, trajectory, onnx, urdf, mjcf, parameters, or another name of
    etude plugins."""
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
    """In C: Hz of the calls; --single is taken where only that is fast enough, and what nothing keeps is
    refused. trajectory: of its table."""
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
        exported = export(campaign, self.to, self.output, **options)
        lines = [*exported.said, "Written:", *(f"  {exported.folder / name}" for name in exported.files)]
        data = {"target": exported.target, "folder": str(exported.folder), "files": list(exported.files)}
        return Outcome("\n".join(lines), {**data, **exported.facts})


@dataclass(frozen=True, kw_only=True)
class Predict(Common):
    """Write the commands that the model expects along a motion, each with its deviation, and where it is
    outside of what that command was learned from: its deviation is more than twice that of training. Commands
    fade to physics, or to a level, where nothing is known, as in every export. The deviation is that of one
    sample as the model learns it, its noise included: logs are filtered or averaged to the model's rate.
    row_deviation is that of a single recorded row, which scatters more.
    """

    folder: Folder
    motion: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="MOTION")]
    """A trajectory.json, or a table with a time and the robot's columns, named as in logs. Velocities and
    accelerations that it lacks are made of the positions, as learning makes them. Of a vehicle t, x, y, z
    are enough: the path is then planned."""
    output: Path | None = None
    """CSV or Parquet to write; MOTION.commands.csv beside the motion by default."""
    degrees: bool = False
    """The table's angles and rates are in degrees."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.deployment.predict import check_table, predict, write_table

        campaign = opened(self.folder)
        path = self.output or self.motion.with_name(f"{self.motion.stem}.commands.csv")
        check_table(path)
        prediction = predict(campaign, self.motion, degrees=self.degrees, say=say)
        write_table(path, prediction)
        for sentence in prediction.repairs:
            say(sentence)
        channel = prediction.channels["command"]
        units = ", ".join(f"{p} [{u or '1'}]" for p, u in zip(channel.parts, channel.units, strict=True))
        outside = dict(zip(channel.parts, prediction["outside"].mean(axis=0).tolist(), strict=True))
        data = {
            "output": str(path),
            "rows": len(prediction),
            "outside": outside,
            "repairs": list(prediction.repairs),
        }
        return Outcome(f"{len(prediction)} commands and deviations of {units}\nWritten: {path}", data)
