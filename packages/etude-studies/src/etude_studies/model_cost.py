"""Cost of trained models in use: the time of a prediction, and the memory of their arrays."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from etude.types import Array


class Predicts(Protocol):
    """Mean (T,) and variance (T,) at inputs (T, D)."""

    def predict(self, X: Array) -> tuple[Array, Array]: ...


def predict_seconds(posteriors: Sequence[Predicts], X: Array, repeats: int) -> float:
    """Median processor time of mean and variance at X (T, D) from all posteriors, after a first call."""
    times = np.empty(repeats)
    for i in range(-1, repeats):
        start = time.process_time()
        for posterior in posteriors:
            posterior.predict(X)
        times[i] = time.process_time() - start
    return float(np.median(times))


def held_bytes(thing: object) -> int:
    """Bytes of all arrays that can be reached from `thing`, each once: what it keeps in memory.

    Goes through attributes (what was computed for a prediction and kept is among them), sequences and
    mappings; a view counts with all of the array that it looks into. Python's own objects are left out.
    """
    arrays: dict[int, int] = {}
    visited: dict[int, object] = {}
    waiting: list[object] = [thing]
    while waiting:
        item = waiting.pop()
        if id(item) in visited:
            continue
        visited[id(item)] = item
        if isinstance(item, np.ndarray):
            owner: Any = item
            while isinstance(owner.base, np.ndarray):
                owner = owner.base
            arrays[id(owner)] = owner.nbytes
        else:
            waiting += _parts(item)
    return sum(arrays.values())


def _parts(item: object) -> list[object]:
    """What an object holds; nothing for numbers, words, functions and types."""
    if isinstance(item, dict):
        return list(item.values())
    if isinstance(item, list | tuple | set | frozenset):
        return list(item)
    if isinstance(item, type) or callable(item):
        return []
    slots = [name for kind in type(item).__mro__ for name in getattr(kind, "__slots__", ())]
    return [*getattr(item, "__dict__", {}).values(), *(getattr(item, name, None) for name in slots)]
