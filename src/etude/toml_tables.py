"""Frozen dataclasses from TOML that people edit by hand, and back; file and key in every message.

`read_table` lays a table over known values, as campaign.toml does over a preset; `from_table` makes a value
from a table alone, as a robot file does, where every limit must be stated.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import typing
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from etude.errors import UsageError, did_you_mean

T = TypeVar("T")
CORRECT = "Correct that place, or restore the file from a copy."
types_of: Callable[[Any], dict[str, Any]] = functools.lru_cache(typing.get_type_hints)
"""Types of a dataclass's fields, by name: annotations are text, which takes long to read."""
CHANGE = "Change that value in the file."
STATE_ALL = "State each of them, because nothing is guessed."


def decoded(text: str, where: str) -> dict[str, Any]:
    """The tables of TOML text. UsageError with the line if it is no TOML."""
    import tomllib

    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as problem:
        raise UsageError(f"not valid TOML: {problem}", where=where, next_step=CORRECT) from None


@functools.cache
def packaged(path: Path) -> Mapping[str, Any]:
    """The tables of a file that comes with the code, which is read once."""
    return decoded(read_text(path), path.name)


def read_text(path: Path, what: str = "file") -> str:
    """The text of a file that a person names. UsageError if there is none, or it cannot be read."""
    try:
        return path.read_text(encoding="utf-8-sig")  # some editors begin a file with a byte order mark
    except FileNotFoundError:
        raise UsageError(f"there is no {what} {path}", next_step="Check the path.") from None
    except (OSError, UnicodeDecodeError) as problem:
        raise UsageError(
            f"the {what} cannot be read: {problem}",
            where=str(path),
            next_step="Check that it is a text file in UTF-8 that you may read, or restore it from a copy.",
        ) from None


EXAMPLES: Mapping[Any, tuple[str, str]] = {
    bool: ("true or false", "true"),
    int: ("a whole number", "2"),
    float: ("a number", "0.5"),
    str: ("a text in quotes", '"text"'),
}
"""Type of a value -> in words, and an example."""


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
    _require_table(table, where)
    names = [field.name for field in _fields(kind)]
    refuse_unknown(table, names, where)
    types = types_of(kind)
    values = {key: converted(types[key], value, key, where) for key, value in table.items()}
    return _construct(kind, {**{name: getattr(start, name) for name in names}, **values}, where)


def from_table(kind: type[T], table: Any, where: str) -> T:
    """The dataclass that `table` states; keys without a default must be there.

    A field that is a dataclass is a table of its own, a tuple of dataclasses an array of tables; one of those
    is called by its name in messages, after the field's metadata "label" if it has one.

    Raises:
        UsageError: as `read_table`; or a key is missing.
    """
    _require_table(table, where)
    fields = _fields(kind)
    refuse_unknown(table, [field.name for field in fields], where)
    missing = [field.name for field in fields if _required(field) and field.name not in table]
    if missing:
        raise UsageError(f"missing {', '.join(missing)}", where=where, next_step=STATE_ALL)
    types = types_of(kind)
    values = {
        field.name: _nested(field, types[field.name], table[field.name], where)
        for field in fields
        if field.name in table
    }
    return _construct(kind, values, where)


def refuse_unknown(table: Mapping[str, Any], valid: list[str], where: str) -> None:
    """Raises UsageError for the first key that is not in `valid`, with the valid ones."""
    for key in table:
        if key not in valid:
            raise UsageError(
                f"unknown key {key!r}",
                where=where,
                next_step=f"{did_you_mean(key, valid)}Valid keys: {', '.join(valid) or 'none'}.",
            )


def write_table(name: str, value: Any, comments: Mapping[str, str]) -> str:
    """A TOML table with every field, each followed by its comment; tables within it come last.

    The header of an empty one is commented out: who adds it, as messages and docs say, adds it once.
    """
    lines, tables = [f"[{name}]"], []
    for field in dataclasses.fields(value):
        item, comment = getattr(value, field.name), comments.get(field.name, "")
        if isinstance(item, Mapping):
            head = f"[{name}.{field.name}]" if item else f"# [{name}.{field.name}]"
            rows = [f"{toml_value(key)} = {toml_value(entry)}" for key, entry in item.items()]
            tables += [f"{head:<34} # {comment}" if comment else head, *rows]
            continue
        text = f"{field.name} = {toml_value(item)}"
        lines.append(f"{text:<34} # {comment}" if comment else text)
    return "\n".join([*lines, *tables]) + "\n"


def write_values(value: Any, comments: tuple[str, ...] = ()) -> str:
    """TOML that `from_table` reads back to the same value; what is at its default is left out.

    comments: sentences on top, for instance what a person should confirm.
    """
    lines = [f"# {line}" for comment in comments for line in comment.splitlines()]
    lines += [f"{name} = {_in_lines(item)}" for name, item in _without_defaults(value) if not _is_table(item)]
    for name, item in _without_defaults(value):
        if _is_table(item):
            several = isinstance(item, tuple)
            for one in item if several else (item,):
                lines += ["", f"[[{name}]]" if several else f"[{name}]"]
                # keys of a plug-in's table are names of arguments
                named = list(one.items()) if several and isinstance(one, Mapping) else _entries(one)
                lines += [f"{key} = {toml_value(v)}" for key, v in named]
    return "\n".join(lines) + "\n"


def toml_value(value: Any) -> str:
    """A value as TOML; JSON's scalars and lists of them are TOML too, but for one control character."""
    if value is None:
        return '"none"'
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = dataclasses.asdict(value)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{toml_value(key)} = {toml_value(item)}" for key, item in value.items()) + "}"
    if isinstance(value, tuple):
        value = list(value)
    return json.dumps(value, allow_nan=False, ensure_ascii=False).replace("\x7f", "\\u007f")


def _in_lines(value: Any) -> str:
    """Sentences one a line, since people take them out; everything else on one."""
    text = toml_value(value)
    sentences = isinstance(value, tuple) and all(isinstance(one, str) and " " in one for one in value)
    if not value or not sentences:
        return text
    return "[\n" + "".join(f"    {toml_value(one)},\n" for one in value) + "]"


def _fields(kind: Any) -> tuple[dataclasses.Field[Any], ...]:
    return dataclasses.fields(kind)


def _required(field: dataclasses.Field[Any]) -> bool:
    missing = dataclasses.MISSING
    return field.default is missing and field.default_factory is missing


def _require_table(table: Any, where: str) -> None:
    if not isinstance(table, Mapping):
        raise UsageError("expected a table of keys", where=where, next_step="Write it as [section].")


def _nested(field: dataclasses.Field[Any], expected: Any, value: Any, where: str) -> Any:
    """The value of one field: tables become dataclasses."""
    inner = _dataclass_in(expected)
    if inner is None:
        return converted(expected, value, field.name, where)
    if typing.get_origin(expected) is not tuple:
        return from_table(inner, value, f"{where} [{field.name}]")
    if not isinstance(value, list) or not all(isinstance(one, Mapping) for one in value):
        raise UsageError(
            f"{field.name} must be an array of tables", where=where, next_step=f"Write [[{field.name}]]."
        )
    label = field.metadata.get("label", field.name)
    return tuple(
        from_table(
            inner, one, f"{where}, " + (f"{label} '{one['name']}'" if "name" in one else f"{label} {i}")
        )
        for i, one in enumerate(value, start=1)
    )


def _dataclass_in(expected: Any) -> Any:
    """The dataclass that a field's type holds, if it does: itself, one or None, or a tuple of them."""
    if dataclasses.is_dataclass(expected):
        return expected
    return next((one for one in typing.get_args(expected) if dataclasses.is_dataclass(one)), None)


def converted(expected: Any, value: Any, key: str, where: str) -> Any:
    """A value of TOML as that type; UsageError with key and place if it is none."""
    import msgspec

    if value == "none" and type(None) in typing.get_args(expected):  # TOML has no null
        return None
    if isinstance(value, Mapping) and typing.get_origin(expected) is Mapping:
        inner = typing.get_args(expected)[1]
        return {name: converted(inner, item, f"{key}.{name}", where) for name, item in value.items()}
    try:
        return msgspec.convert(value, expected)
    except msgspec.ValidationError:
        takes, example = _described(expected)
        raise UsageError(
            f"{key} takes {takes}, not {_shown(value)}",
            where=f"{where} {key}",
            next_step=f"Write it as in {key.rpartition('.')[2]} = {example}",
        ) from None


def _shown(value: Any) -> str:
    try:
        return toml_value(value)
    except (TypeError, ValueError):  # a date or nan, which TOML has and JSON has not
        return str(value)


def _described(expected: Any) -> tuple[str, str]:
    """Values of a type in words, and an example."""
    if expected in EXAMPLES:
        return EXAMPLES[expected]
    arguments = typing.get_args(expected)
    inner = [one for one in arguments if one not in (type(None), Ellipsis)]
    if typing.get_origin(expected) is typing.Literal:
        words = [toml_value(one) for one in inner]
        return " or ".join(words), words[0]
    described = [_described(one) for one in inner]
    words, examples = [one for one, _ in described], [example for _, example in described]
    if typing.get_origin(expected) is tuple:
        count = "" if Ellipsis in arguments else f"{len(inner)} "
        return (
            f"a list of {count}entries, each {' or '.join(dict.fromkeys(words))}",
            f"[{', '.join(examples)}]",
        )
    if inner:
        none = ['"none"'] if type(None) in arguments else []
        return " or ".join([*words, *none]), examples[0]
    return f"a value of type {expected.__name__ if isinstance(expected, type) else expected}", "..."


def _construct(kind: type[T], values: dict[str, Any], where: str) -> T:
    """The dataclass; an error of its own checks names the file and has a next step."""
    try:
        return kind(**values)
    except (UsageError, ValueError) as error:
        named = error if isinstance(error, UsageError) else UsageError(str(error))
        place = f"{where} {named.where}".strip()
        raise UsageError(named.fact, where=place, next_step=named.next_step or CHANGE) from None


def _without_defaults(value: Any) -> list[tuple[str, Any]]:
    """(field, value) of what is not at its default."""
    return [
        (field.name, getattr(value, field.name))
        for field in dataclasses.fields(value)
        if _required(field) or getattr(value, field.name) != _default(field)
    ]


def _default(field: dataclasses.Field[Any]) -> Any:
    made = field.default_factory
    return field.default if made is dataclasses.MISSING else made()


def _entries(table: Any) -> list[tuple[str, Any]]:
    """Keys and values of one table; those of a mapping are quoted, as they are any text."""
    if isinstance(table, Mapping):
        return [(toml_value(key), item) for key, item in table.items()]
    return _without_defaults(table)


def _is_table(value: Any) -> bool:
    if isinstance(value, Mapping):
        return bool(value)
    if isinstance(value, tuple):
        return bool(value) and (dataclasses.is_dataclass(value[0]) or isinstance(value[0], Mapping))
    return dataclasses.is_dataclass(value)
