"""The seam between the campaign and what it learns with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from etude.campaign.folder import Campaign
from etude.campaign.state import State

Say = Callable[[str], None]


@dataclass(frozen=True)
class Learned:
    """What learning a log left.

    Attributes:
        files: stored models.
        facts: of the `trained` event.
    """

    files: list[Path]
    facts: dict[str, Any]


class Learner(Protocol):
    """Turns all told logs into stored models."""

    def __call__(self, campaign: Campaign, state: State, number: int) -> Learned:
        """Learns log `number`, with all logs told before it."""
        ...
