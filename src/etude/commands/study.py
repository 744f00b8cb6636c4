"""etude study"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from etude.commands.common import Common
from etude.commands.live import served
from etude.commands.outcome import Outcome, Say
from etude.commands.studies import functions, no_study, require_studies, room_of, rooms, run_study
from etude.commands.terminal import width
from etude.errors import UsageError

ACTIONS = ("list", "run", "show", "report")
OPTIONS = (
    *("seed", "seeds", "folder", "workers", "cluster", "shard", "method", "limit_s", "go_on"),
    *("update", "paper"),
)
"""Of a study of many ids."""
LINE = "{:15} {:>5}  {:21}  {}"
LEAST = 24
"""Characters of what an id is about, however narrow the terminal."""
LISTED = ("what", "seeds", "verdict", "command")
SEEDS = 4
"""Of a study that does not plan its own."""


@dataclass(frozen=True, kw_only=True)
class Study(Common):
    """Tables, figures and claims of the thesis, and other studies: list them, run one, show what is known of
    one, or write all as pages.
    """

    action: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="list|run|show|report")]
    """list: every id with its seeds and verdict; run ID: compute it, or go on where it was stopped; show ID:
    the numbers that come with Étude; report: pages of all of them."""

    id: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="ID")] = ""
    """What to run or show: table-6.9, figure-5.1, C6.2-3, thesis, or another study."""

    seed: int = 0
    """The first seed."""

    seeds: int | None = None
    """How many seeds, counted from the first; as many as are planned if not given."""

    folder: Path = Path("results")
    """Where results are kept; what was interrupted goes on from there."""

    workers: int | None = None
    """Processes; one a core if not given."""

    cluster: str = ""
    """tcp://host:port of a Dask scheduler that computes instead of this machine."""

    shard: str = ""
    """i/n: only the i-th of n parts, for the array jobs of a batch system."""

    method: str = ""
    """module:factory of a model, kernel or criterion of yours, in the place of the one of each row."""

    limit_s: float | None = None
    """Seconds that one run may take before it is ended and reported."""

    go_on: bool = False
    """Take the results that come with Étude as done."""

    output: Path = Path("study-site")
    """Where report writes its pages."""

    paper: Path | None = None
    """With report: also write every table and curve as PDF and SVG for publications into this folder."""

    update: bool = False
    """With report, for maintainers: commit the results of the folder to the sources first."""

    serve: bool = False
    """With report: show the pages in a browser of this machine instead, with the results that the folder has
    so far, until Ctrl-C; nothing is written."""

    port: int | None = None
    """Of --serve; a free one if not given."""

    def run(self, say: Say) -> Outcome:
        require_studies()
        if self.action not in ACTIONS:  # the short form of the studies that have one id each
            return self._one(self.action)
        if self.action == "list":
            return _listed()
        if self.action == "report":
            return self._served(say) if self.serve else self._report()
        if not self.id:
            raise UsageError(f"{self.action} what?", where="ID", next_step="etude study list shows all ids.")
        room = room_of(self.id)
        if room is None:
            if self.action == "run" and self.id in functions():
                return self._one(self.id)
            raise no_study(self.id)
        text, data = room.run(self.id, self._options, say) if self.action == "run" else room.show(self.id)
        return Outcome(text, data)

    def _one(self, name: str) -> Outcome:
        if self.seeds is not None and self.seeds < 1:
            raise UsageError(f"{self.seeds} seeds are none", where="--seeds", next_step="Give 1 or more.")
        options = {"json": self.json, "seed": self.seed, "seeds": SEEDS if self.seeds is None else self.seeds}
        run_study("study", name, options, {}, folder=self.folder / name)
        return Outcome("")

    def _report(self) -> Outcome:
        found = [room.report(self.output, self._options) for room in rooms()]
        if not found:
            raise UsageError("no study writes pages")
        return Outcome("\n".join(text for text, _ in found), {"pages": [data for _, data in found]})

    def _served(self, say: Say) -> Outcome:
        found = [room.live(self._options) for room in rooms() if hasattr(room, "live")]
        if not found:
            raise UsageError("no study writes pages")
        return served(found[0], self.port, self.json, say)

    @property
    def _options(self) -> dict[str, object]:
        return {name: getattr(self, name) for name in OPTIONS}


def _listed() -> Outcome:
    rows = [own for room in rooms() for own in room.rows()]
    data = [{"metric": own.id, **{name: getattr(own, name) for name in LISTED}} for own in rows]
    for name, what in functions().items():
        command = f"etude study run {name}"
        data.append({"metric": name, "what": what, "seeds": 0, "verdict": "", "command": command})
    lines = [LINE.format("id", "seeds", "verdict", "what")]
    for own in data:
        seeds, verdict = own["seeds"] or "-", own["verdict"] or "-"
        head = LINE.format(own["metric"], seeds, verdict, "")
        lines.append(head + _short(str(own["what"]), width() - len(head)))
    return Outcome("\n".join(lines), {"rows": data})


def _short(text: str, room: int) -> str:
    """As much of it as there is room for."""
    room = max(LEAST, room)
    return text if len(text) <= room else f"{text[: room - 3]}..."
