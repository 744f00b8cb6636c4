"""Live page of a run: the motion in space, with the robot's commanded and measured pose.

A process of its own makes the page, so that drawing takes no time of the loop that sends set-points. The run
writes one line for each fact to its standard input, and omits what the pipe cannot take at once.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import time
import webbrowser
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from threading import Thread
from types import TracebackType
from typing import IO, Any, Self

import numpy as np

from etude.campaign.record.folder import Campaign
from etude.drivers import PlannedMotion, Sample
from etude.errors import EtudeError
from etude.report.live import HOST, INDEX, POSES, POSES_HZ, Pages, server
from etude.report.markup import Html, document, element, paragraph
from etude.report.motion_in_space import placed_parts
from etude.report.record import Record, read_record
from etude.report.scene import figure_along
from etude.report.space import asset, newest, page
from etude.types import Array, Motion

NICE = 10
"""How far the page stands back behind all that moves the robot."""
ATOMIC = 4096
"""Bytes that a pipe takes whole or not at all."""
WAITS = "The next motion is being planned. It will be shown here."


class RunView:
    """The page of one run while it is open.

    Attributes:
        address: for a browser of this machine.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.address = ""
        self._last_sent = 0.0
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        """Starts the page. EtudeError: it does not start."""
        command = [sys.executable, "-P", "-m", "etude.report.run_view", str(self.folder)]
        # a session of its own: Ctrl-C is the robot's, and the page shows how it comes to rest
        self._process = process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
        )
        assert process.stdin is not None
        assert process.stdout is not None
        os.set_blocking(process.stdin.fileno(), False)
        self.address = process.stdout.readline().decode().strip()
        if not self.address:
            self.__exit__(None, None, None)
            step = "Its messages are above. Leave out --view."
            raise EtudeError("the page of the run did not start", next_step=step)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        """Ends the page's process; browsers keep the last picture."""
        if self._process is not None:
            self._process.terminate()
            with contextlib.suppress(OSError):
                self._process.communicate()

    def open(self) -> None:
        """Opens the page in a browser, if there is a screen."""
        if sys.platform != "linux" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
            webbrowser.open(self.address)

    def show(self, number: int) -> None:
        """Shows the motion of a proposal, before the robot moves."""
        self._send({"number": number})

    def put(self, campaign: Campaign, planned: PlannedMotion, sample: Sample) -> None:
        """Shows a sample of a motion, if the time for a picture has come; never waits."""
        now = time.monotonic()
        if now - self._last_sent < 1.0 / POSES_HZ or not np.isfinite(sample.q).all():
            return
        self._last_sent = now
        columns = [planned.joints.index(axis) for axis in campaign.axes]
        commanded = sample.q if sample.asked is None else sample.asked
        path = planned.part == "motion" and planned.speed == 100
        self._send(
            {
                "number": planned.number,
                "t": sample.at if path else None,
                "q": sample.q[columns].tolist(),
                "asked": commanded[columns].tolist(),
                "now": f"{planned.part} {planned.number} at {planned.speed} %",
            }
        )

    def _send(self, facts: Mapping[str, Any]) -> None:
        assert self._process is not None
        assert self._process.stdin is not None
        line = (json.dumps(facts) + "\n").encode()
        if len(line) <= ATOMIC:
            with contextlib.suppress(OSError):  # it is busy, or was ended: the run goes on
                os.write(self._process.stdin.fileno(), line)


class PageState:
    """State of the page.

    Attributes:
        number: of the proposal; None before the first.
    """

    def __init__(self, folder: Path) -> None:
        self.record: Record = read_record(folder)
        self.number: int | None = None
        self._newest: Mapping[str, Any] = {}

    def take(self, facts: Mapping[str, Any]) -> None:
        """Takes one line of the run; from any thread."""
        self.number = facts["number"]
        self._newest = facts if "q" in facts else {}

    def message(self) -> str:
        """JSON for the page: time, and the measured and commanded robot; "" before the first sample.

        Kinematics are computed only when a page asks.
        """
        facts = self._newest
        if not facts:
            return ""
        real, commanded = (self._placed(np.array(facts[name])) for name in ("q", "asked"))
        values = {"t": facts["t"], "now": facts["now"], **real, "asked": commanded}
        return json.dumps(values, separators=(",", ":"), allow_nan=False)

    def _placed(self, q: Array) -> Mapping[str, Any]:
        """Positions, frames (B, 12) of parts and points (P, 3) of sticks at a pose (k,), rad or m."""
        assert self.record.campaign is not None
        placed = placed_parts(self.record.campaign, Motion(np.zeros(1), q[None, None]))[1]
        figure = None if placed.size else figure_along(self.record, q[None])
        points = [] if figure is None else figure.points[0].tolist()
        return {"q": q.tolist(), "frames": placed[0].reshape(-1, 12).tolist(), "points": points}


def served_in_space(folder: Path) -> tuple[Pages, PageState]:
    """Pages with the motion of a run, renewed with it, and the object that takes the run's lines."""
    shown = PageState(folder)

    def made() -> dict[str, Callable[[], str]]:
        number = shown.number
        if number is None:
            style = element("style", Html(asset("report.css")))
            return {INDEX: lambda: document("Étude run", style, element("main", paragraph(WAITS)))}
        now = read_record(folder)
        return {INDEX: cache(lambda: page(now, newest(now, number), POSES)[0])}

    return Pages(made, lambda: f"{shown.number}", shown.message), shown


def serve(folder: Path, lines: IO[str]) -> None:
    """Prints the address, and serves until the lines end."""
    pages, shown = served_in_space(folder)
    with server(pages, None) as web_server:
        sys.stdout.write(f"http://{HOST}:{web_server.server_address[1]}/\n")
        sys.stdout.flush()
        Thread(target=web_server.serve_forever, daemon=True).start()
        for line in lines:
            shown.take(json.loads(line))
        web_server.shutdown()


if __name__ == "__main__":
    os.nice(NICE)
    serve(Path(sys.argv[1]), sys.stdin)
