"""Facts of a journal from the JSON values of its lines."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from etude import campaign
from etude.campaign import FORMAT, Event, Fact, event_from_json


def fact(event: str, **facts: Any) -> Fact:
    """A fact, as if a journal had said so."""
    envelope = {
        "event": event,
        "version": FORMAT,
        "time": "",
        "number": None,
        "config_sha256": "",
        "files": {},
    }
    return event_from_json(json.dumps({**envelope, **facts})).fact


def trained(**facts: Any) -> Fact:
    """A training."""
    return fact("trained", **{"chosen": "gp", **facts})


def commit(
    folder: Path, event: str, number: int | None, config_sha256: str, files: list[Path], **facts: Any
) -> Event:
    """Appends that fact to the journal in a folder."""
    return campaign.commit(folder, fact(event, **facts), number, files, config_sha256=config_sha256)
