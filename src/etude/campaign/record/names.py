"""Names of joints and other parts: they stand in headers of tables, on the screen and in file names."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from etude.errors import UsageError

REFUSED = ("Cc", "Cs", "Zl", "Zp")
"""Categories of Unicode: control characters, halves of pairs, ends of lines and of paragraphs."""
TURNING = frozenset("\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")
"""What turns the direction of writing, so that a name is shown as another."""


def require_plain(names: Iterable[str], where: str) -> None:
    """UsageError: a name is empty, begins or ends with a blank, or holds what no line of text can show."""
    for name in names:
        bad = [c for c in name if unicodedata.category(c) in REFUSED or c in TURNING]
        if bad:
            told = f"holds {unicodedata.name(bad[0], f'U+{ord(bad[0]):04X}')}, which no line of text can show"
        elif name != name.strip() or not name:
            told = "is empty, or begins or ends with a blank"
        else:
            continue
        raise UsageError(
            f"the name {name!r} {told}",
            where=where,
            next_step="Rename it in the robot's file: names are headers of tables, and words on the screen.",
        )


def names_of(table: Any) -> list[str]:
    """Every `name` in the tables of a robot.toml."""
    if isinstance(table, Mapping):
        own = [value for key, value in table.items() if key == "name" and isinstance(value, str)]
        return [*own, *(name for value in table.values() for name in names_of(value))]
    if isinstance(table, Sequence) and not isinstance(table, str | bytes):
        return [name for value in table for name in names_of(value)]
    return []
