"""The ledger of the thesis: its claims, figures and tables as data, from `claims.toml`, `tables.toml`, and
`beyond.toml`, which has what the thesis does not ask.

A claim says which statistic of which runs answers it; an entry is one figure or table, with the numbers that
the thesis printed. Both files are checked as a whole when they are read, so that nothing is left without an
answer and nothing is answered twice.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeVar

import msgspec

from etude.errors import UsageError
from etude_studies.thesis import ledger_checks as checks
from etude_studies.thesis.ledger_checks import BEYOND, CLAIMS, TABLES
from etude_studies.thesis.ledger_items import Ambiguity, Claim, Entry, Ledger, Part, Row, Why

HERE = Path(__file__).parent
__all__ = ["Ambiguity", "Claim", "Entry", "Ledger", "Part", "Row", "Why", "load_ledger"]

Item = TypeVar("Item")


def load_ledger(folder: Path = HERE) -> Ledger:
    """Claims and entries of the three files of `folder`, checked together.

    Raises:
        UsageError: a file that is missing or no TOML; an unknown key or statistic; an alias with parts or of
            an alias; a figure or table that is missing or there twice; a name that nothing bears. File and
            id are said.
    """
    claims, tables = _read(folder / CLAIMS, ("claim",)), _read(folder / TABLES, ("entry", "ambiguity"))
    beyond = _read(folder / BEYOND, ("entry", "why"))
    ledger = Ledger(
        claims=_made(Claim, claims, "claim", CLAIMS),
        entries=(*_made(Entry, tables, "entry", TABLES), *_made(Entry, beyond, "entry", BEYOND)),
        ambiguities=_made(Ambiguity, tables, "ambiguity", TABLES),
        whys=_made(Why, beyond, "why", BEYOND),
    )
    checks.check(ledger)
    return ledger


def _read(path: Path, keys: tuple[str, ...]) -> dict[str, Any]:
    """The arrays of tables of a file."""
    import tomllib

    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as problem:
        step = "Restore it from a copy of the package."
        raise UsageError(f"cannot be read: {problem}", where=path.name, next_step=step) from None
    for key in (*tables, *keys):
        if key not in keys or not isinstance(tables.get(key), list):
            step = f"Write {' and '.join(f'[[{key}]]' for key in keys)} only."
            raise UsageError(f"{key!r} is missing, or not expected here", where=path.name, next_step=step)
    return tables


def _made(kind: type[Item], tables: dict[str, Any], key: str, file: str) -> tuple[Item, ...]:
    """Values of a kind from an array of tables; what msgspec refuses is said with the id."""
    made = []
    for number, table in enumerate(tables[key], start=1):
        id = table.get("id", f"{key} {number}") if isinstance(table, dict) else f"{key} {number}"
        try:
            made.append(msgspec.convert(table, kind))
        except msgspec.ValidationError as problem:
            step = f"Keys and values are described in {kind.__name__} of ledger_items.py."
            raise UsageError(str(problem), where=f"{file}, {id}", next_step=step) from None
    return tuple(made)
