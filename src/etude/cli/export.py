"""etude export, etude predict"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from etude.cli.outcome import Common, Folder, Outcome, Say, opened


@dataclass(frozen=True, kw_only=True)
class Export(Common):
    """Write the model in a form that another program runs, or the identified parameters as a file.

    Targets: C99 for a controller's loop, a controller for ROS 2, an addition to PX4 or a Crazyflie, a
    trajectory with commands, ONNX; for the parameters a model file or a table.
    """

    folder: Folder
    to: str
    """Target: c, ros2, online, px4, crazyflie, trajectory, onnx, urdf, mjcf, parameters, or another name that
    etude plugins lists."""
    output: Path | None = None
    """Folder to write. Default: exports/TARGET in the campaign's folder. An earlier export there is
    replaced."""
    real: Literal["double", "float"] | None = None
    """c, onnx: type of the numbers. float is refused where its results would be wrong."""
    variance: bool = False
    """c, onnx: also compute the variance of each command."""
    fade: bool = True
    """c, ros2, onnx: where the data add nothing to the prior, commands fade to the physics or to a constant
    level, as in etude predict. This needs variances. --no-fade: the posterior mean everywhere."""
    single: bool = False
    """c: only the best ensemble member of each command, where several are averaged."""
    rate: float | None = None
    """c: rate of the calls in Hz. --single is used where only it is fast enough; a rate that no form reaches
    is refused. trajectory: rate of its table."""
    name: str = ""
    """Prefix of files and functions. Default: the robot's name."""
    more: Annotated[tuple[str, ...], tyro.conf.arg(name="set", metavar="NAME=VALUE")] = ()
    """Options of one target: motion or format (trajectory), interface (ros2), or those of another package's
    target."""

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
        lines = [*exported.notes, "Written:", *(f"  {exported.folder / name}" for name in exported.files)]
        data = {"target": exported.target, "folder": str(exported.folder), "files": list(exported.files)}
        return Outcome("\n".join(lines), {**data, **exported.facts})


@dataclass(frozen=True, kw_only=True)
class Predict(Common):
    """Write the commands that the model predicts along a motion, each with its standard deviation.

    The column outside marks commands whose deviation is more than twice that in training. Where nothing is
    known, commands fade to the physics or to a constant level, as in every export. The deviation is that of
    one training sample with its noise; logs are filtered or averaged to the model's rate. row_deviation is
    that of one recorded row, which scatters more.
    """

    folder: Folder
    motion: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="MOTION")]
    """A trajectory.json, or a table with a time and the robot's columns, named as in logs. Missing velocities
    and accelerations are computed from the positions, as in training. Vehicles: t, x, y, z are enough; the
    path is then planned."""
    output: Path | None = None
    """CSV or Parquet file to write. Default: MOTION.commands.csv beside the motion."""
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
