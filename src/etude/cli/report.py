"""etude report, and --serve: pages until Ctrl-C"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from etude.cli.outcome import Common, Folder, Outcome, Say, opened
from etude.errors import UsageError

if TYPE_CHECKING:
    from etude.report.live import Pages


def served(pages: Pages, port: int | None, as_json: bool, say: Say) -> Outcome:
    """Serves until it is interrupted. UsageError: the port is in use, or an outcome is waited for."""
    from etude.report.live import HOST, server

    if as_json:
        step = "Leave out --json or --serve."
        raise UsageError("--serve runs until Ctrl-C and returns no result", where="--json", next_step=step)
    with server(pages, port) as web_server:
        say(f"Served on this machine: http://{HOST}:{web_server.server_address[1]}/ (Ctrl-C ends it)")
        web_server.serve_forever()
    return Outcome("")


@dataclass(frozen=True, kw_only=True)
class Report(Common):
    """Write report.html: one file that opens offline, made from the campaign's facts alone."""

    folder: Folder
    serve: bool = False
    """Show the report in a browser on this machine, updated until Ctrl-C. No file is written."""
    port: int | None = None
    """Port for --serve. Default: a free one."""

    def run(self, say: Say) -> Outcome:
        from etude.report.build import build_report, live_report

        opened(self.folder)
        if self.serve:
            return served(live_report(self.folder), self.port, self.json, say)
        say("Drawing the report.")
        path = build_report(self.folder)
        return Outcome(f"Written: {path}", {"report": str(path)})
