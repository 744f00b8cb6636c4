"""--serve: pages until Ctrl-C."""

from __future__ import annotations

from typing import TYPE_CHECKING

from etude.commands.outcome import Outcome, Say
from etude.errors import UsageError

if TYPE_CHECKING:
    from etude.report.live import Pages


def served(pages: Pages, port: int | None, as_json: bool, say: Say) -> Outcome:
    """Serves until it is interrupted. UsageError: the port is in use, or an outcome is waited for."""
    from etude.report.live import HOST, server

    if as_json:
        step = "Leave --json out, or --serve."
        raise UsageError("--serve ends by Ctrl-C, and has no outcome", where="--json", next_step=step)
    with server(pages, port) as found:
        say(f"Served to this machine: http://{HOST}:{found.server_address[1]}/ (Ctrl-C ends it)")
        found.serve_forever()
    return Outcome("")
