"""Options of an export target: those of the command that the user gave."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import Field, fields
from typing import Any, TypeVar

from etude.errors import UsageError

MODEL_HASH = "model_hash"
"""Always among them: SHA-256 of the model's file, "" where it has none."""
WORDS = {"yes": True, "true": True, "1": True, "no": False, "false": False, "0": False, "": False}
"""What may be written for a switch."""
T = TypeVar("T")


def taken(options: Mapping[str, Any], known: type[T], target: str) -> T:
    """The options as that dataclass, defaults where nothing was given.

    A text, as `--set NAME=VALUE` gives it, is read as what its field is declared to be: bool, int or float.

    Raises:
        UsageError: an option that the target does not know, or a text that is none of these.
    """
    names = [own.name for own in fields(known)]  # type: ignore[arg-type]
    unknown = [name for name in options if name not in names]
    if unknown:
        flags = ", ".join(f"--{name.replace('_', '-')}" for name in unknown)
        own = ", ".join(f"--{name.replace('_', '-')}" for name in names if name != MODEL_HASH)
        raise UsageError(f"--to {target} has no option {flags}", next_step=f"It has {own or 'none'}.")
    own_fields = {own.name: own for own in fields(known)}  # type: ignore[arg-type]
    return known(**{name: _read(own_fields[name], value) for name, value in options.items()})


def _read(own: Field[Any], value: Any) -> Any:
    """The value as its field declares it, if it is a text and the field takes no texts."""
    if not isinstance(value, str):
        return value
    declared = {word.strip() for word in _declared(own).split("|")} - {"None"}
    if declared == {"bool"}:
        if value.strip().lower() not in WORDS:
            raise UsageError(f"{own.name} is yes or no, not {value!r}", where=f"--set {own.name}")
        return WORDS[value.strip().lower()]
    if declared in ({"float"}, {"int"}):
        number = int if declared == {"int"} else float
        try:
            found = number(value)
        except ValueError:
            found = math.nan
        if not math.isfinite(found):
            raise UsageError(f"{own.name} is a number, not {value!r}", where=f"--set {own.name}")
        return found
    return value


def _declared(own: Field[Any]) -> str:
    """What was written behind the field's name, whether annotations are texts in its module or not."""
    kind: Any = own.type
    return kind if isinstance(kind, str) else kind.__name__ if isinstance(kind, type) else str(kind)
