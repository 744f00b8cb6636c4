"""The result of a command: text for people, data for programs, an exit code."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Protocol

import tyro

from etude.cli.terminal import width

if TYPE_CHECKING:
    from etude.campaign.record.folder import Campaign


Folder = Annotated[Path, tyro.conf.Positional, tyro.conf.arg(help="The campaign folder.", metavar="FOLDER")]


@dataclass(frozen=True, kw_only=True)
class Common:
    """Options of every command.

    Attributes:
        prints: whether the command prints its own line of JSON, as studies and benches do.
    """

    prints: ClassVar[bool] = False
    json: bool = False
    """Print one line of JSON on stdout instead of text."""
    trust: bool = False
    """Allow the code that the folder's files name as module:attribute. Remembered for this user and
    folder."""

    def trust_files(self) -> Path | None:
        """Puts what the command names on this user's list, before it runs; None: the command does so itself.
        UsageError: it has no campaign's folder.
        """
        from etude.campaign.record.config_file import trust_campaign
        from etude.errors import UsageError

        folder = vars(self).get("folder")
        if folder is None:
            raise UsageError(
                "--trust needs a command with a campaign's folder",
                next_step="Give it once: etude status FOLDER --trust.",
            )
        trust_campaign(folder)
        return Path(folder)


def opened(folder: Path) -> Campaign:
    """The campaign in a folder."""
    from etude.campaign.record.folder import open_campaign

    return open_campaign(folder)


Say = Callable[[str], None]
TRUSTED = "Code that the files in {} name is trusted from now on for this user."
CHANGED, UNUSABLE = 6, 3
"""Exit codes: the robot has changed, so that somebody has to say what it is now; a file cannot be used."""


@dataclass(frozen=True)
class Outcome:
    """The result of a command.

    Attributes:
        text: printed on stdout for people.
        data: printed on stdout as one line of JSON under --json.
        exit_code: 0 unless the command succeeded in finding out something bad.
    """

    text: str
    data: Mapping[str, Any] = field(default_factory=dict)
    exit_code: int = 0


class Command(Protocol):
    """What `cli` runs."""

    @property
    def json(self) -> bool: ...
    @property
    def trust(self) -> bool: ...
    @property
    def prints(self) -> bool: ...

    def trust_files(self) -> Path | None:
        """Trusts them, and says which; None: `run` does it."""
        ...

    def run(self, say: Say, /) -> Outcome:
        """Does the work; `say` shows progress on stderr."""
        ...


def to_json(data: Mapping[str, Any]) -> str:
    """One line of strict JSON; numbers that JSON cannot carry become null."""
    return json.dumps(_plain(data), allow_nan=False, ensure_ascii=False)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, str | int | float | bool | None):
        return value
    return str(value)


def table(header: list[str], rows: list[list[str]], keys: int = 1) -> str:
    """Columns of text, the first aligned left and the others right.

    What is wider than the terminal is continued below: the first `keys` columns again, then more columns.
    """
    widths = [max(len(line[i]) for line in [header, *rows]) for i in range(len(header))]
    parts = [_aligned([header, *rows], widths, columns) for columns in _pages(widths, keys)]
    return "\n".join(parts)


def _pages(widths: list[int], keys: int) -> list[list[int]]:
    """Which columns stand beside each other."""
    first = list(range(keys))
    pages, used = [[*first]], sum(widths[:keys]) + 2 * (keys - 1)
    room = used
    for i in range(keys, len(widths)):
        if room + 2 + widths[i] > width() and len(pages[-1]) > keys:
            pages.append([*first])
            room = used
        pages[-1].append(i)
        room += 2 + widths[i]
    return pages


def _aligned(lines: list[list[str]], widths: list[int], columns: list[int]) -> str:
    printed = []
    for line in lines:
        cells = [line[i].rjust(widths[i]) if i else line[i].ljust(widths[i]) for i in columns]
        printed.append("  ".join(cells).rstrip())
    return "\n".join(printed)


def code_of(*, changed: bool, refused: bool = False) -> int:
    """Of several logs: a robot that has changed counts before a file that was refused."""
    return CHANGED if changed else UNUSABLE if refused else 0
