"""etude tell"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from etude.commands.common import Common, Folder, opened
from etude.commands.outcome import Outcome, Say


@dataclass(frozen=True, kw_only=True)
class Tell(Common):
    """Take in a log and learn it. Any order, any delay; the same log twice changes nothing."""

    folder: Folder
    log: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="LOG")]
    """CSV, Parquet, a ROS 2 bag, a PX4 log, ... with the time and, by name, what the robot measures: of an
    arm positions and commands of every joint; of a quadrotor accelerometer, gyroscope and commands, and if
    known position and attitude."""
    number: int | None = None
    """The trajectory that was run; else the newest open one that the motion fits."""
    foreign: bool = False
    """The log answers no proposal."""
    degrees: bool = False
    """All angles and rates of the log are in degrees."""
    accept: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """A check whose question is answered with: take the log as it is. Can be given several times."""
    repair: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """A check whose question is answered with: put it right. Can be given several times."""
    topic: tuple[str, ...] = ()
    """Topics of a bag to read, joined by time; none: those with joint states."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.tell import tell

        campaign = opened(self.folder, say)
        found = tell(
            campaign,
            self.log,
            number=self.number,
            foreign=self.foreign,
            degrees=self.degrees,
            accept=self.accept,
            repair=self.repair,
            topics=self.topic,
            say=say,
        )
        what = "a recording of its own" if found.foreign else "the answer to that proposal"
        first = f"Log {found.number} ({what}) was told before." if found.repeated else ""
        lines = [first or f"Log {found.number} stored, {what}."]
        if found.repairs:
            lines += ["Repairs:", *(f"  - {sentence}" for sentence in found.repairs)]
        if found.learned:
            lines.append(f"Learned: {', '.join(map(str, found.learned))}.")
        lines += [f"Warning: {sentence}" for sentence in found.warnings]
        lines.append(f"Next: etude status {self.folder}, etude ask {self.folder}")
        data = {
            "number": found.number,
            "repeated": found.repeated,
            "foreign": found.foreign,
            "repairs": found.repairs,
            "learned": found.learned,
            "warnings": found.warnings,
        }
        return Outcome("\n".join(lines), data)
