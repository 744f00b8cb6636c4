"""The journal: one JSON object a line, append-only. It is the campaign's only memory of what happened."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from etude.errors import UsageError
from etude.storage import append_line, read_lines, sha256_of

JOURNAL = "journal.jsonl"
EVENTS = ("created", "asked", "exported", "told", "trained", "evaluated", "abandoned")


@dataclass(frozen=True)
class Event:
    """One fact.

    Attributes:
        event: one of `EVENTS`.
        time: when it was committed, ISO 8601 with the zone.
        number: trajectory it speaks of; None for facts about the whole campaign.
        config_sha256: hash of campaign.toml at that moment.
        files: path relative to the campaign folder -> SHA-256, for each file the fact rests on.
        facts: everything else, as JSON values.
    """

    event: str
    time: str
    number: int | None
    config_sha256: str
    files: dict[str, str] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)

    def to_line(self) -> str:
        own = {"event": self.event, "time": self.time, "number": self.number}
        return json.dumps(
            {**own, "config_sha256": self.config_sha256, "files": self.files, **self.facts}, allow_nan=False
        )


def read_events(folder: Path) -> list[Event]:
    """Every committed event, oldest first. A torn last line was never committed and is left out.

    Raises:
        UsageError: a whole line is not an event, so somebody edited the journal.
    """
    path = Path(folder) / JOURNAL
    return [_parse(line, f"{path}:{number}") for number, line in enumerate(read_lines(path), 1)]


def commit(
    folder: Path, event: str, number: int | None, config_sha256: str, files: list[Path], **facts: Any
) -> Event:
    """Appends one event, with the hash of each of `files` (already on the disk, inside `folder`).

    The caller holds the writer's lock. When this returns, the event survives any crash.
    """
    if event not in EVENTS:
        raise ValueError(f"{event!r} is not one of {EVENTS}")
    hashes = {str(path.relative_to(folder).as_posix()): sha256_of(path) for path in files}
    now = datetime.now(UTC).isoformat(timespec="milliseconds")
    fact = Event(event, now, number, config_sha256, hashes, facts)
    append_line(folder / JOURNAL, fact.to_line())
    return fact


def damaged_files(folder: Path, events: list[Event]) -> list[str]:
    """One sentence for each committed file that is missing or no longer has its recorded hash."""
    last = {name: digest for event in events for name, digest in event.files.items()}
    problems = []
    for name, digest in sorted(last.items()):
        path = folder / name
        if not path.exists():
            problems.append(f"{name} is missing")
        elif sha256_of(path) != digest:
            problems.append(f"{name} was changed after it was committed")
    return problems


def _parse(line: str, where: str) -> Event:
    try:
        fields = json.loads(line)
        known = {name: fields.pop(name) for name in ("event", "time", "number", "config_sha256", "files")}
    except (ValueError, KeyError, AttributeError, TypeError):
        raise UsageError(
            "this line of the journal is not an event",
            where=where,
            next_step="The journal is written by etude alone; put the line back as it was.",
        ) from None
    if known["event"] not in EVENTS:
        raise UsageError(f"unknown event {known['event']!r}", where=where, next_step="Use the newer etude.")
    return Event(**known, facts=fields)


def jsonable(values: Iterable[float]) -> list[float | None]:
    """Finite values as JSON numbers, the others as null: figures as the journal keeps them."""
    return [float(v) if math.isfinite(v) else None for v in values]
