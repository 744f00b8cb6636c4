"""etude abandon"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro

from etude.commands.common import Common, Folder, opened
from etude.commands.outcome import Outcome, Say


@dataclass(frozen=True, kw_only=True)
class Abandon(Common):
    """Give a trajectory up: its log will never come, or must not be used. Telling it takes that back."""

    folder: Folder
    number: Annotated[int, tyro.conf.Positional]
    """Of the trajectory."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.ingest.untell import abandon

        changed = abandon(opened(self.folder, say), self.number, say=say)
        text = f"Trajectory {self.number} is abandoned." if changed else "It was abandoned before."
        return Outcome(text, {"number": self.number, "changed": changed})
