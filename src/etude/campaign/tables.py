"""Strict TOML tables: a frozen dataclass read from a table that people edit by hand, and written back."""

from __future__ import annotations

import dataclasses
import difflib
import json
import typing
from collections.abc import Mapping
from typing import Any, TypeVar

from etude.errors import UsageError

T = TypeVar("T")


def read_table(kind: type[T], table: Any, start: T, where: str) -> T:
    """`start` with the values of `table` put over it; each value must have its field's type.

    Args:
        kind: the frozen dataclass.
        table: what TOML gave for it.
        start: the values of keys that the table leaves out.
        where: file and section, for messages.

    Raises:
        UsageError: not a table, an unknown key (named with the valid ones), or a value that is impossible.
    """
    import msgspec

    if not isinstance(table, Mapping):
        raise UsageError("expected a table of keys", where=where, next_step="Write it as [section].")
    fields = {field.name: field for field in dataclasses.fields(kind)}  # type: ignore[arg-type]
    refuse_unknown(table, list(fields), where)
    values = {name: getattr(start, name) for name in fields}
    types = typing.get_type_hints(kind)
    for key, value in table.items():
        try:
            values[key] = None if _stands_for_none(value, types[key]) else msgspec.convert(value, types[key])
        except msgspec.ValidationError as error:
            raise UsageError(
                f"{key} = {_text(value)} is not possible: {error}", where=f"{where} {key}"
            ) from None
    try:
        return kind(**values)
    except (UsageError, ValueError) as error:
        fact = error.fact if isinstance(error, UsageError) else str(error)
        inner = error.where if isinstance(error, UsageError) and error.where else ""
        raise UsageError(fact, where=f"{where} {inner}".strip()) from None


def refuse_unknown(table: Mapping[str, Any], valid: list[str], where: str) -> None:
    """Raises UsageError for the first key that is not in `valid`, with the valid ones."""
    for key in table:
        if key not in valid:
            near = difflib.get_close_matches(key, valid, 1)
            hint = f"Did you mean {near[0]}? " if near else ""
            raise UsageError(
                f"unknown key {key!r}", where=where, next_step=f"{hint}Valid keys: {', '.join(valid)}."
            )


def write_table(name: str, value: Any, comments: Mapping[str, str]) -> str:
    """A TOML table with every field, each followed by its comment."""
    lines = [f"[{name}]"]
    for field in dataclasses.fields(value):
        text = f"{field.name} = {_text(getattr(value, field.name))}"
        comment = comments.get(field.name, "")
        lines.append(f"{text:<34} # {comment}" if comment else text)
    return "\n".join(lines) + "\n"


def _stands_for_none(value: Any, expected: Any) -> bool:
    """TOML has no null: "none" stands for it where the field may be None."""
    return value == "none" and type(None) in typing.get_args(expected)


def _text(value: Any) -> str:
    """A value as TOML; JSON's scalars and lists of them are TOML too."""
    if value is None:
        return '"none"'
    if isinstance(value, tuple):
        value = list(value)
    return json.dumps(value, allow_nan=False, ensure_ascii=False)
