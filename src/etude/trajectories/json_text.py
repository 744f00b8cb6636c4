"""The JSON form of trajectories: exact numbers out, a strict reading in."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np

from etude.errors import UsageError

T = TypeVar("T")


def to_text(kind: str, fields: Mapping[str, Any]) -> str:
    """JSON text of a trajectory; floats are printed so that they read back to the same bits."""
    content = {name: np.asarray(value, dtype=float).tolist() for name, value in fields.items()}
    return json.dumps({"kind": kind, **content}, indent=1) + "\n"


def from_text(text: str | bytes, kinds: Mapping[str, type[T]]) -> T:
    """The trajectory in `text`, made by the class that `kinds` names for its kind.

    Raises:
        UsageError: not JSON, an unknown kind, missing or unknown keys, or values that make no trajectory.
    """
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UsageError(f"the trajectory file is not JSON: {error}") from None
    if not isinstance(content, dict) or content.get("kind") not in kinds:
        raise UsageError(f"the trajectory file's 'kind' is not one of: {', '.join(kinds)}")
    made_by = kinds[content.pop("kind")]
    try:
        return made_by(**content)
    except (TypeError, ValueError) as error:
        raise UsageError(f"the trajectory file does not describe a trajectory: {error}") from None
