"""etude view"""

from __future__ import annotations

from dataclasses import dataclass

from etude.cli.outcome import Common, Folder, Outcome, Say, opened


@dataclass(frozen=True, kw_only=True)
class View(Common):
    """Show a motion before the robot moves: view.html, one file that opens offline, with the robot in space,
    what stands around it, what it sweeps, and how near it comes.
    """

    folder: Folder
    proposal: int | None = None
    """Number of the trajectory; the newest if not given."""

    def run(self, say: Say) -> Outcome:
        from etude.report.record import read_record
        from etude.report.space import nearest_words, newest, page
        from etude.storage import write_atomic

        opened(self.folder)
        record = read_record(self.folder)
        number = newest(record, self.proposal)
        say("Drawing the motion.")
        text, seen = page(record, number)
        path = self.folder / "view.html"
        write_atomic(path, text.encode("utf-8"))
        data = {"view": str(path), "proposal": number, "seconds": float(seen.t[-1]), "nearest": seen.nearest}
        return Outcome(f"Written: {path}\n{nearest_words(seen)}", data)
