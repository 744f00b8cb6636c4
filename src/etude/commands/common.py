"""What every command has."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from etude.campaign.record.folder import Campaign

Folder = Annotated[Path, tyro.conf.Positional, tyro.conf.arg(help="The campaign folder.", metavar="FOLDER")]


@dataclass(frozen=True, kw_only=True)
class Common:
    """Options of every command."""

    json: bool = False
    """Print one line of JSON on stdout instead of text."""
    trust: bool = False
    """Run code that the folder's files name as module:attribute; remembered for you and this folder."""


def opened(folder: Path, say: Callable[[str], None]) -> Campaign:
    """The campaign in a folder; says what a reader of its campaign.toml should know."""
    from etude.campaign.record.folder import open_campaign

    campaign = open_campaign(folder)
    for note in campaign.notes:
        say(note)
    return campaign
