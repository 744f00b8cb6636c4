"""etude untell, etude abandon"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro

from etude.cli.outcome import Common, Folder, Outcome, Say, opened


@dataclass(frozen=True, kw_only=True)
class Numbered(Common):
    """A command on one trajectory of a campaign, or on its log."""

    folder: Folder
    number: Annotated[int, tyro.conf.Positional]
    """Of the trajectory, which is that of its log."""

    def outcome(self, what: str, done: str, changed: bool) -> Outcome:
        """What was done to it, or had been done before."""
        text = f"{what} {self.number} is {done}." if changed else f"It was {done} before."
        return Outcome(text, {"number": self.number, "changed": changed})


@dataclass(frozen=True, kw_only=True)
class Untell(Numbered):
    """Take back a log that was told by mistake: the model is trained without it, its proposal open again."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.ingest.tell import untell

        return self.outcome("Log", "taken back", untell(opened(self.folder), self.number, say=say))


@dataclass(frozen=True, kw_only=True)
class Abandon(Numbered):
    """Give a trajectory up: its log will never come, or must not be used. Telling it takes that back."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.ingest.tell import abandon

        return self.outcome("Trajectory", "abandoned", abandon(opened(self.folder), self.number, say=say))
