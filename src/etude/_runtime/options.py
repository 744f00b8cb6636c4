"""Options of an export target: those of the command that the user gave."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import Field, fields
from typing import Any, TypeVar

from etude.errors import UsageError, did_you_mean

MODEL_HASH = "model_hash"
"""Option of every target: SHA-256 of the model's file, "" without a file."""
SUPPLIED = (MODEL_HASH, "config", "logs", "samples", "description")
"""Options that the campaign gives, and no user."""
FLAGS = {
    "real": "--real",
    "variance": "--variance",
    "fade": "--no-fade",
    "single": "--single",
    "rate": "--rate",
    "name": "--name",
}
"""Options that `etude export` has by name; a target takes all others through `--set`."""
WORDS = {"yes": True, "true": True, "1": True, "no": False, "false": False, "0": False, "": False}
"""Texts of a switch."""
T = TypeVar("T")


def taken(options: Mapping[str, Any], options_type: type[T], target: str) -> T:
    """The options as that dataclass, defaults where nothing was given.

    A text, as `--set NAME=VALUE` gives it, is read as what its field is declared to be: bool, int or float.

    Raises:
        UsageError: an option that the target does not know, or a text that is none of these.
    """
    names = [field.name for field in fields(options_type)]  # type: ignore[arg-type]
    unknown = [name for name in options if name not in names]
    if unknown:
        valid = [name for name in names if name not in SUPPLIED]
        hint = did_you_mean(unknown[0], valid)
        raise UsageError(
            f"--to {target} has no option {', '.join(map(_as_typed, unknown))}",
            next_step=f"{hint}It has {', '.join(map(_as_typed, valid)) or 'none'}.",
        )
    by_name = {field.name: field for field in fields(options_type)}  # type: ignore[arg-type]
    return options_type(**{name: _read(by_name[name], value) for name, value in options.items()})


def _as_typed(name: str) -> str:
    """An option as the command line takes it."""
    return FLAGS.get(name, f"--set {name}=VALUE")


def _read(field: Field[Any], value: Any) -> Any:
    """The value as its field declares it, if it is a text and the field takes no texts."""
    if not isinstance(value, str):
        return value
    declared = {word.strip() for word in _declared(field).split("|")} - {"None"}
    if declared == {"bool"}:
        if value.strip().lower() not in WORDS:
            raise UsageError(
                f"{field.name} must be yes or no, not {value!r}",
                where=f"--set {field.name}",
                next_step=f"Write --set {field.name}=yes or --set {field.name}=no.",
            )
        return WORDS[value.strip().lower()]
    if declared in ({"float"}, {"int"}):
        number = int if declared == {"int"} else float
        try:
            parsed = number(value)
        except ValueError:
            parsed = math.nan
        if not math.isfinite(parsed):
            raise UsageError(
                f"{field.name} must be a number, not {value!r}",
                where=f"--set {field.name}",
                next_step=f"Write --set {field.name}=NUMBER.",
            )
        return parsed
    return value


def _declared(field: Field[Any]) -> str:
    """Annotation of the field as text."""
    kind: Any = field.type
    return kind if isinstance(kind, str) else kind.__name__ if isinstance(kind, type) else str(kind)
