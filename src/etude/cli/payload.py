"""etude payload"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from etude.cli.outcome import Common, Folder, Outcome, Say, opened
from etude.errors import typed


@dataclass(frozen=True, kw_only=True)
class Payload(Common):
    """Estimate the load in one log: mass and centre of mass, with 95 % intervals.

    The load is the difference from the robot that the model in use knows. Nothing is learned.
    """

    folder: Folder
    log: Path
    """A log of any motion, in any format that etude tell reads."""
    write: bool = False
    """Add the load to [payload] of robot.toml."""
    degrees: bool = False
    """All angles and rates of the log are in degrees."""
    accept: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Name of a check: use the log without a repair. Can be given several times."""
    repair: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Name of a check: repair the log. Can be given several times."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.deployment.payload import payload

        weighed = payload(
            opened(self.folder),
            self.log,
            write=self.write,
            degrees=self.degrees,
            accept=self.accept,
            repair=self.repair,
            say=say,
        )
        load, lines = weighed.load, list(weighed.notes)
        if weighed.written is not None:
            lines.append(f"Written: [payload] of {weighed.written}")
            lines.append(
                f"The model does not include this load yet. Next: etude ask {typed(self.folder)} --new"
            )
        low, high = load.interval
        data = {
            "verdict": load.verdict,
            "mass": load.mass,
            "mass_lower": low,
            "mass_upper": high,
            "centre": load.centre.tolist(),
            "centre_deviation": load.centre_deviation.tolist(),
            "left": load.left,
            "written": None if weighed.written is None else str(weighed.written),
        }
        return Outcome("\n".join(lines), data)
