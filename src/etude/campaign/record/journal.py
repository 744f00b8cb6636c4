"""Journal of a campaign: one JSON object a line, append-only; the only record of its events.

The lines form a chain of hashes, which every reading checks. Each line ends with two hashes: `previous` is
the SHA-256 of the line before, and `seal` is the SHA-256 of this line's own text up to `seal`.

The chain cannot detect lines cut off at the end, because the rest is a valid shorter chain. Only files that
those lines named, if still present, show the loss. The chain is no signature either: whoever recomputes every
hash after an edit writes another valid journal.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path

from etude.campaign.record.events import (
    Event,
    Fact,
    Figures,
    NewerFormatError,
    Trained,
    event_from_json,
    event_to_json,
)
from etude.codes import Notice, OfFile
from etude.errors import UsageError
from etude.storage import GENERATION, append_line, read_lines, sha256_of

JOURNAL = "journal.jsonl"
BY_HAND = ("robot.toml", "campaign.toml")
"""Files that people edit: each event has the hashes of them as they were then."""

PREVIOUS, SEAL = "previous", "seal"
REMEMBERED = 2**15
"""Lines that were read before: a campaign reads its journal for each step of a command."""
_HASH = "[0-9a-f]{64}"
_END = re.compile(
    rf'(?P<text>.*, "{PREVIOUS}": "(?P<previous>{_HASH})"), "{SEAL}": "(?P<seal>{_HASH})"\}}', re.DOTALL
)
_UNCHANGED = "Only etude may write the journal. Restore it from a copy or your backup."


def chained(text: str, before: Sequence[str]) -> str:
    """The line of a JSON object's `text` after the lines `before`."""
    open_text = f'{text[:-1]}, "{PREVIOUS}": "{_last_hash(before)}"'
    return f'{open_text}, "{SEAL}": "{_sha256(open_text)}"}}'


def is_chained(line: str) -> bool:
    """Whether a line ends with both hashes, right or wrong."""
    return _END.fullmatch(line) is not None


def check_chain(lines: Sequence[str], path: object) -> None:
    """Checks every line against its seal and against the line before.

    Raises:
        UsageError: a line was deleted, moved or edited; says which. The first line has no hashes.
    """
    if lines and not is_chained(lines[0].removesuffix("\r")):
        raise UsageError(
            "this journal has no hashes: an early version of Étude wrote it, or its first line was edited",
            where=f"{path}:1",
            next_step="Restore the line from a copy; or create a new campaign with etude init, and "
            "ingest the logs in runs/.",
        )
    link = _last_hash([])
    for i, line in enumerate(lines):
        previous, following = _hashes(line)
        if line.endswith("\r"):
            raise _changed_error("the line endings of the journal were changed, LF to CRLF", path, i)
        if not following:
            raise _changed_error("this line of the journal was edited", path, i)
        if previous != link:
            raise _changed_error(
                "a line of the journal was deleted, added or moved just before this one", path, i
            )
        link = following


@lru_cache(maxsize=REMEMBERED)
def _hashes(line: str) -> tuple[str, str]:
    """The hash of the previous line and of this line, as a line states them; "" for an edited line."""
    match = _END.fullmatch(line)
    whole = match is not None and match["seal"] == _sha256(match["text"])
    return (match["previous"], _sha256(line)) if match is not None and whole else ("", "")


def _last_hash(before: Sequence[str]) -> str:
    """The hash of the last line, for the next one."""
    return _sha256(before[-1] if before else "")


def _sha256(text: str) -> str:
    # a damaged line may hold bytes that are no text; storage.read_lines gives them as surrogates
    return hashlib.sha256(text.encode(errors="surrogateescape")).hexdigest()


def _changed_error(fact: str, path: object, index: int) -> UsageError:
    return UsageError(fact, where=f"{path}:{index + 1}", next_step=_UNCHANGED)


def read_events(folder: Path) -> list[Event]:
    """Every committed event, oldest first; without a torn last line, which was never committed.

    Raises:
        UsageError: the journal was edited: a whole line is not an event, or the chain is broken. Or the
            version that wrote it is newer, or too old.
    """
    path = Path(folder) / JOURNAL
    lines = read_lines(path)
    check_chain(lines, path)
    return [_parse(line, f"{path}:{number}") for number, line in enumerate(lines, 1)]


def commit(
    folder: Path,
    fact: Fact,
    number: int | None = None,
    files: Sequence[Path] = (),
    *,
    config_sha256: str = "",
    robot_sha256: str = "",
) -> Event:
    """Appends one event with the hash of each of `files` (already on the disk, inside `folder`).

    The caller holds the writer's lock. After the return, the event survives any crash.
    """
    hashes = {str(path.relative_to(folder).as_posix()): sha256_of(path) for path in files}
    now = datetime.now(UTC).isoformat(timespec="milliseconds")
    event = Event(fact, now, number, config_sha256, hashes, robot_sha256, GENERATION)
    append_line(folder / JOURNAL, chained(event_to_json(event), read_lines(folder / JOURNAL)))
    return event


def recorded(events: Iterable[Event]) -> dict[str, str]:
    """SHA-256 of each committed file by name, as it was last committed."""
    return {name: digest for event in events for name, digest in event.files.items()}


def damaged_files(folder: Path, events: list[Event]) -> list[Notice]:
    """A notice for each committed file that is missing or has another hash than recorded.

    Files that people edit count only if they are missing. Superseded models may be missing.
    """
    gone = {name for name in superseded(events) if not (folder / name).exists()}
    return damaged(folder, {name: digest for name, digest in recorded(events).items() if name not in gone})


MODEL = "model.npz"
KEPT_MODELS = 8
"""Models of the newest trainings that stay on the disk: each has megabytes, and logs teach it again."""


def superseded(events: Iterable[Event]) -> list[str]:
    """Names of the models of all trainings but the newest `KEPT_MODELS`, oldest first."""
    order: dict[str, None] = {}
    for event in events:
        for name in event.files if isinstance(event.fact, Trained) else ():
            if name.endswith(f"/{MODEL}"):
                order.pop(name, None)
                order[name] = None
    return list(order)[:-KEPT_MODELS]


def damaged(folder: Path, files: Mapping[str, str]) -> list[Notice]:
    """A notice for each of these files, by name with their SHA-256, that is missing or changed."""
    problems = []
    for name, digest in sorted(files.items()):
        try:
            if sha256_of(folder / name) != digest and name not in BY_HAND:
                problems.append(Notice(OfFile.CHANGED, {"file": name}))
        except (FileNotFoundError, NotADirectoryError):
            problems.append(Notice(OfFile.MISSING, {"file": name}))
        except OSError as error:
            why = error.strerror or str(error)
            problems.append(Notice(OfFile.UNREADABLE, {"file": name, "why": why}))
    return problems


def require_intact(folder: Path, files: Mapping[str, str], next_step: str) -> None:
    """Checks files, by name with their SHA-256, before their use.

    Raises:
        UsageError: a file is missing or was changed; says which.
    """
    problems = damaged(folder, files)
    if problems:
        raise UsageError(
            "; ".join(problem.sentence for problem in problems), where=str(folder), next_step=next_step
        )


def _parse(line: str, where: str) -> Event:
    try:
        line.encode()  # bytes that are no text came as surrogates
        return _event(line)
    except NewerFormatError as newer:
        raise UsageError(
            f"a newer version of Étude wrote this line of the journal ({newer})",
            where=where,
            next_step="Use that version of Étude, or a later one.",
        ) from None
    except (ValueError, TypeError, RecursionError):
        raise UsageError(
            "this line of the journal is not an event",
            where=where,
            next_step="Only etude may write the journal. Restore the line.",
        ) from None


_event = lru_cache(maxsize=REMEMBERED)(event_from_json)


def jsonable(values: Iterable[float]) -> Figures:
    """The values for the journal, with None for values that are not finite."""
    return tuple(float(v) if math.isfinite(v) else None for v in values)
