"""etude view"""

from __future__ import annotations

from dataclasses import dataclass

from etude.cli.outcome import Common, Folder, Outcome, Say, opened


@dataclass(frozen=True, kw_only=True)
class View(Common):
    """Show a motion before the robot moves: view.html, one file that opens offline.

    The page shows the robot in space, the obstacles, the swept range, and the least distances.
    """

    folder: Folder
    proposal: int | None = None
    """Number of the trajectory. Default: the newest."""

    def run(self, say: Say) -> Outcome:
        from etude.report.space import describe_nearest, write_view

        opened(self.folder)
        say("Drawing the motion.")
        path, number, view = write_view(self.folder, self.proposal)
        data = {"view": str(path), "proposal": number, "seconds": float(view.t[-1]), "nearest": view.nearest}
        return Outcome(f"Written: {path}\n{describe_nearest(view)}", data)
