"""etude report"""

from __future__ import annotations

from dataclasses import dataclass

from etude.commands.common import Common, Folder, opened
from etude.commands.outcome import Outcome, Say


@dataclass(frozen=True, kw_only=True)
class Report(Common):
    """Write report.html: one file, opens offline, made from the campaign's facts alone."""

    folder: Folder

    def run(self, say: Say) -> Outcome:
        from etude.report.build import build_report

        opened(self.folder, say)
        say("Drawing the report.")
        path = build_report(self.folder)
        return Outcome(f"Written: {path}", {"report": str(path)})
