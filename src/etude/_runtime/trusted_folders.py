"""Trust in folders that name code: this user's list, kept outside every folder.

A name of the form module:attribute is code that is imported and run. One that a person types or passes in
Python is that person's own word. One that stands in a file is the word of whoever wrote the file, and counts
where this user made the folder (`etude init`) or said so (`--trust`).

An entry holds the folder's id, which is the hash of its journal's first line, and where it lies. The id alone
would be no proof: it travels with every copy, so whoever has seen a folder of yours could send it back with
other names in it. A secret in the folder would travel too. So a copy, even on the same machine, is another
folder, and a folder that was moved is trusted again by one command.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.machinery
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from etude.errors import UsageError
from etude.storage import read_lines

OWN = frozenset(
    f"etude{end}" for end in ("", "_arm", "_drivers", "_lagrangian", "_online", "_quadrotor", "_sparse")
)
"""Packages that come with Étude: what they bring is tested against the protocols, and not guarded."""
FULL_NAME = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_][\w.]*")
"""module:attribute"""


def trust_file() -> Path:
    """Where the list is: a line of JSON for each folder."""
    base = os.environ.get("XDG_CONFIG_HOME", "")
    return (Path(base) if os.path.isabs(base) else Path.home() / ".config") / "etude" / "trusted.jsonl"


def folder_id(mark: Path) -> str:
    """The id of a folder whose first file, which only grows, is `mark`; "" if there is none."""
    first = read_lines(mark)[:1]
    return hashlib.sha256(first[0].encode(errors="surrogateescape")).hexdigest() if first else ""


def trust(folder: Path, identity: str) -> None:
    """Adds a folder to the list. OSError: the list cannot be written."""
    path = trust_file()
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    try:
        os.write(handle, (json.dumps(_entry(folder, identity)) + "\n").encode())
    finally:
        os.close(handle)


def trust_own(folder: Path, identity: str) -> None:
    """The same for a folder that was just made; where no list can be kept, its names are asked for later."""
    with contextlib.suppress(OSError, RuntimeError):  # RuntimeError: there is no home
        trust(folder, identity)


def is_trusted(folder: Path, identity: str) -> bool:
    """Whether the list holds this folder at this place."""
    entry = json.dumps(_entry(folder, identity))
    try:
        return bool(identity) and entry in trust_file().read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError, RuntimeError):
        return False


def require_trusted(named: Mapping[str, str], path: Path, folder: Path, identity: str, command: str) -> None:
    """Nothing, where no code is named or the folder is trusted.

    Args:
        named: full name -> where in the file it stands. path: the file.
        folder: that it belongs to. identity: of that. command: what trusts it.

    Raises:
        UsageError: the folder is not trusted; says what would be run, from where, and how to trust it.
    """
    if not named or is_trusted(folder, identity):
        return
    what = "; ".join(f"{name} ({_source(name)}) as {place}" for name, place in named.items())
    raise UsageError(
        f"{path.name} names code that would be imported and run: {what}",
        where=str(path),
        next_step=f"No such code was run. If you have read it and trust the author of the folder: {command}. "
        "Otherwise, replace it by a name that etude plugins lists.",
    )


def outside_error(path: Path, where: Path, command: str) -> UsageError:
    """The refusal of a path out of the folder, in a file of a folder that is not trusted."""
    return UsageError(
        f"this leads out of its folder, to {path}",
        where=str(where),
        next_step=f"Nothing was read or written there. If you trust the author of the folder: {command}. "
        "Otherwise, copy what is there into the folder, in place of the link or under the name that is used.",
    )


def require_no_links_out(folder: Path, identity: str, command: str) -> None:
    """Raises UsageError if a link in the folder leads out of it, unless the folder is trusted.

    folder, identity, command: as of `require_trusted`.
    """
    if is_trusted(folder, identity):
        return
    for place, folders, files in os.walk(folder):
        for path in (Path(place) / name for name in (*folders, *files)):
            if path.is_symlink() and not path.resolve().is_relative_to(folder.resolve()):
                raise outside_error(path.resolve(), path, command)


def names_in(value: Any, place: str = "") -> dict[str, str]:
    """Full name -> key, of all texts in the values of TOML or JSON."""
    return dict(_walk_names(value, place))


def _walk_names(value: Any, place: str) -> Iterator[tuple[str, str]]:
    if isinstance(value, str):
        if FULL_NAME.fullmatch(value):
            yield value, place
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from _walk_names(item, f"{place}.{key}" if place else str(key))
    elif isinstance(value, Sequence) and not isinstance(value, bytes):
        for item in value:
            yield from _walk_names(item, place)


def _entry(folder: Path, identity: str) -> dict[str, str]:
    return {"id": identity, "folder": str(Path(folder).resolve())}


def _source(name: str) -> str:
    """Path of the code's outermost package; nothing is imported."""
    package = name.partition(":")[0].partition(".")[0]
    try:
        spec = importlib.machinery.PathFinder.find_spec(package)
    except (ImportError, ValueError):
        spec = None
    return (spec.origin if spec is not None and spec.origin else None) or "Python does not find it"
