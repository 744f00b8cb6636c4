"""etude inspect"""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from etude.cli.outcome import Common, Outcome, Say
from etude.errors import DataError, UsageError

if TYPE_CHECKING:
    from etude.campaign.ingest.inspection import Inspected
    from etude.types import Finding

SIGNS = {"green": "ok", "yellow": "look", "red": "WRONG", "cannot tell": "?"}
REFUSED = 3  # exit code of docs/reference: the log would be refused


@dataclass(frozen=True, kw_only=True)
class Inspect(Common):
    """Show how a log was recorded and whether it is plausible, before any campaign.

    Exit code 0: etude tell would accept the log. Exit code 3: it would refuse the log, or ask a question.
    """

    log: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="LOG")]
    """A file in any format that etude tell reads."""
    robot: str = ""
    """A built-in robot, its description, or a campaign's folder. Default: the joints are guessed from the
    headers."""
    degrees: bool = False
    """All angles and rates of the log are in degrees."""
    topic: tuple[str, ...] = ()
    """Topics of a bag to read, joined by time. Default: all topics with joint states."""
    picture: Path | None = None
    """SVG file to write, with positions, commands and marked spans."""
    write_mapping: bool = False
    """Print the table [log.columns] for campaign.toml, which maps the columns of the log. Needs --robot."""

    def run(self, _: Say) -> Outcome:
        from etude.campaign.ingest.inspection import inspect, mapping_of

        if not self.log.exists():
            raise DataError("there is no such log", where=str(self.log), next_step="Check the path.")
        if self.write_mapping:
            if not self.robot:
                raise UsageError(
                    "a mapping needs a robot",
                    where="--write-mapping",
                    next_step="Give --robot too.",
                )
            text = mapping_of(self.log, self.robot, self.topic)
            return Outcome(text.rstrip(), {"mapping": text})
        inspection = inspect(self.log, self.robot or None, degrees=self.degrees, topics=self.topic)
        if self.picture is not None:
            _draw(inspection, self.picture, self.log)
        data = {
            "log": str(self.log),
            "findings": [asdict(f) for f in inspection.findings],
            "refused": inspection.refused,
        }
        return Outcome(_text(inspection, bool(self.robot)), data, REFUSED if inspection.refused else 0)


def _draw(inspection: Inspected, path: Path, source: Path) -> None:
    from etude.report.pictures import recording_picture
    from etude.storage import write_atomic

    if inspection.log is None:
        raise DataError(
            "there are no rows to draw", where=str(source), next_step=inspection.findings[-1].sentence
        )
    write_atomic(path, recording_picture(inspection.log, inspection.findings).encode())


def _text(inspection: Inspected, described: bool) -> str:
    from etude.logs.checks.finding_texts import Mendable

    width = max(len(f.check) for f in inspection.findings)
    lines = [line for f in inspection.findings for line in _lines(f, width)]
    counts = Counter(f.light for f in inspection.findings)
    summary = ", ".join(f"{counts[light]} {light}" for light in ("green", "yellow", "red", "cannot tell"))
    flags = " ".join(dict.fromkeys(f"--accept {f.flag}" for f in inspection.findings if f.flag))
    mended = any(isinstance(f, Mendable) and f.light != "green" for f in inspection.findings)
    end = f"tell would ingest this log{', with the repairs above' if mended else ' without repairs'}."
    if not described:
        end = "no check fails; whether tell would ingest this log depends on the robot (--robot)."
    if any(f.light == "red" and not f.flag for f in inspection.findings):
        end = "tell would refuse this log."
    elif flags:
        end = f"tell would ask a question first; {flags} uses the log without a repair."
    return "\n".join([*lines, "", f"{summary}: {end}"])


def _lines(finding: Finding, width: int) -> list[str]:
    margin = " " * (8 + width)
    step = [f"{margin}next: {finding.step}"] if finding.step and finding.light != "green" else []
    return [f"{SIGNS[finding.light]:<5}  {finding.check:<{width}} {finding.sentence}", *step]
