"""etude predict"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from etude.cli.outcome import Common, Folder, Outcome, Say, opened


@dataclass(frozen=True, kw_only=True)
class Predict(Common):
    """Write the commands that the model expects along a motion, each with its deviation, and where it is
    outside of what that command was learned from: its deviation is more than twice that of training. Commands
    fade to physics, or to a level, where nothing is known, as in every export. The deviation is that of one
    sample as the model learns it, its noise included: logs are filtered or averaged to the model's rate.
    Single rows of a faster log scatter more.
    """

    folder: Folder
    motion: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="MOTION")]
    """A trajectory.json, or a table with a time and the robot's columns, named as in logs. Velocities and
    accelerations that it lacks are made of the positions, as learning makes them."""
    output: Path | None = None
    """CSV or Parquet to write; MOTION.commands.csv beside the motion by default."""
    degrees: bool = False
    """The table's angles and rates are in degrees."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.deployment.predict import check_table, predict, write_table

        campaign = opened(self.folder)
        path = self.output or self.motion.with_name(f"{self.motion.stem}.commands.csv")
        check_table(path)
        found = predict(campaign, self.motion, degrees=self.degrees, say=say)
        write_table(path, found)
        for sentence in found.repairs:
            say(sentence)
        channel = found.channels["command"]
        units = ", ".join(f"{p} [{u or '1'}]" for p, u in zip(channel.parts, channel.units, strict=True))
        outside = dict(zip(channel.parts, found["outside"].mean(axis=0).tolist(), strict=True))
        data = {"output": str(path), "rows": len(found), "outside": outside, "repairs": list(found.repairs)}
        return Outcome(f"{len(found)} commands and deviations of {units}\nWritten: {path}", data)
