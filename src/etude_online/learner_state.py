"""State of objects that learn, as numbers: to go back to, and to be saved without running any code.

A class lists its state in `STATE_FIELDS`, with dots for nested attributes. Objects are built anew; only their
numbers are restored.
"""

from __future__ import annotations

import json
from collections import deque
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from etude.errors import DataError
from etude.storage import arrays_of, packed

WORDS = "words"


@runtime_checkable
class Moving(Protocol):
    """An object with state: the names of what changes in it."""

    STATE_FIELDS: ClassVar[tuple[str, ...]]


def taken(owner: Any) -> Any:
    """A copy of the state of `owner`: one item for each name."""
    return [_copy(_at(owner, name)) for name in owner.STATE_FIELDS]


def put_back(owner: Any, state: Any) -> None:
    """Makes `owner` what it was when `state` was taken. They share nothing: the state can serve again."""
    for name, value in zip(owner.STATE_FIELDS, state, strict=True):
        *attributes, last = name.split(".")
        parent = owner
        for step in attributes:
            parent = getattr(parent, step)
        now = getattr(parent, last)
        if isinstance(now, Moving):
            put_back(now, value)
        elif isinstance(now, list) and now and isinstance(now[0], Moving):
            for member, part in zip(now, value, strict=True):
                put_back(member, part)
        else:
            setattr(parent, last, _restored(value, now))


def state_bytes(state: Any) -> bytes:
    """The file of a state: arrays, and JSON with the place of each."""
    arrays: list[np.ndarray[Any, Any]] = []
    tree = json.dumps(_to_json(state, arrays))
    text = np.frombuffer(tree.encode(), dtype=np.uint8)
    return packed({WORDS: text, **{f"a{i}": a for i, a in enumerate(arrays)}})


def state_of(data: bytes) -> Any:
    """The state of a file's bytes. DataError if they are damaged."""
    try:
        stored = arrays_of(data)
        return _from_json(json.loads(bytes(stored[WORDS])), stored)
    except Exception as error:
        raise DataError(
            f"this is no saved state ({error})", next_step="Open the folder without it: it starts anew."
        ) from error


def _at(owner: Any, name: str) -> Any:
    for step in name.split("."):
        owner = getattr(owner, step)
    return owner


def _copy(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.copy(order="K")
    if isinstance(value, Moving):
        return taken(value)
    if isinstance(value, (list, tuple, deque)):
        return [_copy(part) for part in value]
    return value


def _restored(value: Any, now: Any) -> Any:
    """A copy of a stored value, in the kind of sequence that stands there now."""
    if isinstance(value, np.ndarray):
        return value.copy(order="K")
    if not isinstance(value, list):
        return value
    parts = [_restored(part, None) for part in value]
    if isinstance(now, tuple):
        return type(now)(*parts) if hasattr(now, "_fields") else tuple(parts)
    return deque(map(tuple, parts)) if isinstance(now, deque) else parts


def _to_json(value: Any, arrays: list[np.ndarray[Any, Any]]) -> Any:
    if isinstance(value, np.ndarray):
        arrays.append(value)
        return {"array": len(arrays) - 1}
    if isinstance(value, list):
        return [_to_json(part, arrays) for part in value]
    return value.item() if isinstance(value, np.generic) else value


def _from_json(node: Any, stored: dict[str, np.ndarray[Any, Any]]) -> Any:
    if isinstance(node, dict):
        return stored[f"a{node['array']}"]
    return [_from_json(part, stored) for part in node] if isinstance(node, list) else node
