"""etude view"""

from __future__ import annotations

from dataclasses import dataclass

from etude.cli.outcome import Common, Folder, Outcome, Say, opened
from etude.errors import UsageError, typed


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
        from etude.report.space import nearest_words, page
        from etude.storage import write_atomic

        opened(self.folder)
        record = read_record(self.folder)
        asked = [n for n, r in sorted(record.state.rounds.items()) if r.asked is not None]
        number = self.proposal if self.proposal is not None else max(asked, default=0)
        if number not in asked:
            known = f"They are {', '.join(map(str, asked))}." if asked else f"etude ask {typed(self.folder)}"
            raise UsageError(
                f"there is no proposal {number}" if asked else "nothing has been proposed yet",
                where="--proposal" if self.proposal is not None else str(self.folder),
                next_step=known,
            )
        say("Drawing the motion.")
        text, seen = page(record, number)
        path = self.folder / "view.html"
        write_atomic(path, text.encode("utf-8"))
        data = {"view": str(path), "proposal": number, "seconds": float(seen.t[-1]), "nearest": seen.nearest}
        return Outcome(f"Written: {path}\n{nearest_words(seen)}", data)
