"""etude report"""

from __future__ import annotations

from dataclasses import dataclass

from etude.commands.common import Common, Folder, opened
from etude.commands.live import served
from etude.commands.outcome import Outcome, Say


@dataclass(frozen=True, kw_only=True)
class Report(Common):
    """Write report.html: one file, opens offline, made from the campaign's facts alone."""

    folder: Folder
    serve: bool = False
    """Show it in a browser of this machine instead, renewed as things happen, until Ctrl-C; nothing is
    written."""
    port: int | None = None
    """Of --serve; a free one if not given."""

    def run(self, say: Say) -> Outcome:
        from etude.report.build import build_report, live_report

        opened(self.folder, say)
        if self.serve:
            return served(live_report(self.folder), self.port, self.json, say)
        say("Drawing the report.")
        path = build_report(self.folder)
        return Outcome(f"Written: {path}", {"report": str(path)})
