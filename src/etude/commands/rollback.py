"""etude rollback"""

from __future__ import annotations

from dataclasses import dataclass

from etude.commands.common import Common, Folder, opened
from etude.commands.outcome import Outcome, Say


@dataclass(frozen=True, kw_only=True)
class Rollback(Common):
    """Go back to the model that was in use before the last promotion; nothing is deleted."""

    folder: Folder
    reason: str = ""
    """Kept in the journal."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.deployment.promote import rollback

        left, back = rollback(opened(self.folder, say), reason=self.reason)
        text = f"The model of log {left} is no longer in use; that of log {back} is."
        return Outcome(text, {"left": left, "in_use": back})
