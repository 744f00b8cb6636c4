"""What a target of a model is told beside the model: the options of the command that were given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar

from etude.errors import UsageError

MODEL_HASH = "model_hash"
"""Always among them: SHA-256 of the model's file, "" where it has none."""
T = TypeVar("T")


def taken(options: Mapping[str, Any], known: type[T], target: str) -> T:
    """The options as that dataclass, defaults where nothing was given.

    Raises:
        UsageError: an option that the target does not know.
    """
    names = [own.name for own in fields(known)]  # type: ignore[arg-type]
    foreign = [name for name in options if name not in names]
    if foreign:
        told = ", ".join(f"--{name.replace('_', '-')}" for name in foreign)
        own = ", ".join(f"--{name.replace('_', '-')}" for name in names if name != MODEL_HASH)
        raise UsageError(f"--to {target} has no option {told}", next_step=f"It has {own or 'none'}.")
    return known(**options)
