"""The journal: one JSON object a line, append-only. It is the campaign's only memory of what happened.

Its lines are a chain of hashes, checked whenever it is read. Each line ends with two hashes: `previous` is
the SHA-256 of the line before it, and `seal` is the SHA-256 of this line's own text up to there. Journals of
version 0.1 have neither. They are read as they are; the first line that is added to one carries the hash of
everything before it, and from then on an edit of the old part is found too, though not its line. A line that
lost its hashes is told from one of 0.1 by what else it says: see `NEWER`.

What the chain cannot see: lines cut off at the end leave a whole, shorter chain. Only the files that those
lines spoke of, where they still lie, show that there was more. Nor is it a signature: who computes every hash
behind an edit again has written another journal.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from etude.errors import UsageError
from etude.storage import append_line, read_lines, sha256_of

JOURNAL = "journal.jsonl"
NEWER = frozenset(
    ("kind", "generation", "robot_sha256", "rungs", "controls", "margins", "segments", "recipe", "together")
)
"""Facts that version 0.1 never wrote: a line without hashes that has one had them once."""
BY_HAND = ("robot.toml", "campaign.toml")
"""Files that people edit: each event has the hashes of them as they were then."""
ROBOT_SHA256 = "robot_sha256"
EVENTS = (
    "created",
    "edited",
    "asked",
    "exported",
    "told",
    "untold",
    "changed",
    "trained",
    "evaluated",
    "abandoned",
    "promoted",
    "rolled_back",
    "confirmed",
)


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

    def to_json(self) -> str:
        """The fact alone, without the hashes that make it a line of the journal."""
        own = {"event": self.event, "time": self.time, "number": self.number}
        return json.dumps(
            {**own, "config_sha256": self.config_sha256, "files": self.files, **self.facts}, allow_nan=False
        )


PREVIOUS, SEAL = "previous", "seal"
_HASH = "[0-9a-f]{64}"
_END = re.compile(
    rf'(?P<text>.*, "{PREVIOUS}": "(?P<previous>{_HASH})"), "{SEAL}": "(?P<seal>{_HASH})"\}}', re.DOTALL
)
_UNCHANGED = "The journal is written by etude alone; put it back as it was, from a copy or your backup."


def chained(text: str, before: Sequence[str]) -> str:
    """The line of a JSON object's `text` that follows the lines `before`."""
    open_text = f'{text[:-1]}, "{PREVIOUS}": "{_link(before)}"'
    return f'{open_text}, "{SEAL}": "{_sha256(open_text)}"}}'


def is_chained(line: str) -> bool:
    """Whether it ends with both hashes, right or wrong."""
    return _END.fullmatch(line) is not None


def check_chain(lines: Sequence[str], path: object) -> None:
    """Holds every line against its seal and against the line before it.

    Raises:
        UsageError: a line was deleted, moved or edited; says which.
    """
    first = next((i for i, line in enumerate(lines) if is_chained(line)), len(lines))
    for i in range(first, len(lines)):
        found = _END.fullmatch(lines[i])
        if found is None or found["seal"] != _sha256(found["text"]):
            raise _changed("this line of the journal was edited", path, i)
        # the line before is chained, but for the first one's: that hash is of all before, which may be much
        if found["previous"] == _link(lines[:i] if i == first else lines[i - 1 : i]):
            continue
        if i == first and i > 0:
            raise _changed(f"the journal was changed in its first {i} lines, of version 0.1", path, 0)
        raise _changed("a line of the journal was deleted, added or moved just before this one", path, i)


def _link(before: Sequence[str]) -> str:
    """The hash that the next line carries: of the line before, or of all lines where that one is of 0.1."""
    if before and is_chained(before[-1]):
        return _sha256(before[-1])
    return _sha256("".join(f"{line}\n" for line in before))


def _sha256(text: str) -> str:
    # a damaged line may hold bytes that are no text; storage.read_lines gives them as surrogates
    return hashlib.sha256(text.encode(errors="surrogateescape")).hexdigest()


def _changed(fact: str, path: object, index: int) -> UsageError:
    return UsageError(fact, where=f"{path}:{index + 1}", next_step=_UNCHANGED)


def read_events(folder: Path) -> list[Event]:
    """Every committed event, oldest first. A torn last line was never committed and is left out.

    Raises:
        UsageError: somebody edited the journal: a whole line is not an event, or the chain is broken.
    """
    path = Path(folder) / JOURNAL
    lines = read_lines(path)
    events = [_parse(line, f"{path}:{number}") for number, line in enumerate(lines, 1)]
    check_chain(lines, path)
    return events


def commit(
    folder: Path, event: str, number: int | None, config_sha256: str, files: list[Path], **facts: Any
) -> Event:
    """Appends one event, with the hash of each of `files` (already on the disk, inside `folder`).

    The caller holds the writer's lock. When this returns, the event survives any crash.
    """
    if event not in EVENTS or {PREVIOUS, SEAL} & facts.keys():
        raise ValueError(f"{event!r} is not one of {EVENTS}, or a fact is called {PREVIOUS} or {SEAL}")
    hashes = {str(path.relative_to(folder).as_posix()): sha256_of(path) for path in files}
    now = datetime.now(UTC).isoformat(timespec="milliseconds")
    fact = Event(event, now, number, config_sha256, hashes, facts)
    append_line(folder / JOURNAL, chained(fact.to_json(), read_lines(folder / JOURNAL)))
    return fact


def recorded(events: Iterable[Event]) -> dict[str, str]:
    """SHA-256 of each committed file, by its name, as it was committed last."""
    return {name: digest for event in events for name, digest in event.files.items()}


def damaged_files(folder: Path, events: list[Event]) -> list[str]:
    """One sentence for each committed file that is missing or no longer has its recorded hash; of what people
    edit only if it is missing.
    """
    problems = []
    for name, digest in sorted(recorded(events).items()):
        try:
            if sha256_of(folder / name) != digest and name not in BY_HAND:
                problems.append(f"{name} was changed after it was committed")
        except (FileNotFoundError, NotADirectoryError):
            problems.append(f"{name} is missing")
        except OSError as error:
            problems.append(f"{name} cannot be read ({error.strerror or error})")
    return problems


def require_intact(folder: Path, events: list[Event], next_step: str) -> None:
    """The files that these events rest on, before somebody relies on them.

    Raises:
        UsageError: one is missing or was changed; says which.
    """
    problems = damaged_files(folder, events)
    if problems:
        raise UsageError("; ".join(problems), where=str(folder), next_step=next_step)


def _parse(line: str, where: str) -> Event:
    try:
        line.encode()  # bytes that are no text came as surrogates
        fields = json.loads(line)
        known = {name: fields.pop(name) for name in ("event", "time", "number", "config_sha256", "files")}
        if not (_fits(known) and is_chained(line) == (PREVIOUS in fields) == (SEAL in fields)):
            raise ValueError
    except (ValueError, KeyError, AttributeError, TypeError, RecursionError):
        raise UsageError(
            "this line of the journal is not an event",
            where=where,
            next_step="The journal is written by etude alone; put the line back as it was.",
        ) from None
    if NEWER & fields.keys() and not is_chained(line):
        raise UsageError(
            "the hashes of this line of the journal were taken out",
            where=where,
            next_step="The journal is written by etude alone; put it back as it was, from a copy.",
        )
    if known["event"] not in EVENTS:
        raise UsageError(f"unknown event {known['event']!r}", where=where, next_step="Use the newer etude.")
    return Event(**known, facts={name: fields[name] for name in fields if name not in (PREVIOUS, SEAL)})


def _fits(known: dict[str, Any]) -> bool:
    words = [known["event"], known["time"], known["config_sha256"], *known["files"].values()]
    number = known["number"]
    return all(isinstance(word, str) for word in words) and (number is None or type(number) is int)


def jsonable(values: Iterable[float]) -> list[float | None]:
    """Finite values as JSON numbers, the others as null: figures as the journal keeps them."""
    return [float(v) if math.isfinite(v) else None for v in values]
