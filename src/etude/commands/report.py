"""etude report"""

from __future__ import annotations

from dataclasses import dataclass

from etude.commands.common import Common, Folder
from etude.commands.outcome import Outcome, Say


@dataclass(frozen=True, kw_only=True)
class Report(Common):
    """Write report.html: one file, opens offline, made from the campaign's facts alone."""

    folder: Folder

    def run(self, say: Say) -> Outcome:
        from etude.campaign.folder import open_campaign
        from etude.report.build import build_report

        open_campaign(self.folder)
        say("Drawing the report.")
        path = build_report(self.folder)
        return Outcome(f"Written: {path}", {"report": str(path)})
