"""etude untell, etude abandon"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro

from etude.cli.outcome import Common, Folder, Outcome, Say, opened


@dataclass(frozen=True, kw_only=True)
class Untell(Common):
    """Take back a log that was told by mistake: the model is trained without it, its proposal open again."""

    folder: Folder
    number: Annotated[int, tyro.conf.Positional]
    """Of the log."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.ingest.tell import untell

        changed = untell(opened(self.folder), self.number, say=say)
        text = f"Log {self.number} is taken back." if changed else "It was taken back before."
        return Outcome(text, {"number": self.number, "changed": changed})


@dataclass(frozen=True, kw_only=True)
class Abandon(Common):
    """Give a trajectory up: its log will never come, or must not be used. Telling it takes that back."""

    folder: Folder
    number: Annotated[int, tyro.conf.Positional]
    """Of the trajectory."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.ingest.tell import abandon

        changed = abandon(opened(self.folder), self.number, say=say)
        text = f"Trajectory {self.number} is abandoned." if changed else "It was abandoned before."
        return Outcome(text, {"number": self.number, "changed": changed})
