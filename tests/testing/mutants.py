"""Wrong twins: nouns that break one law each, and the suite that has to notice."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np


class Twin:
    """Behaves like `original` but for the methods given by name; each gets the original first."""

    def __init__(self, original: Any, **changes: Callable[..., Any]) -> None:
        self._original, self._changes = original, changes

    def __getattr__(self, name: str) -> Any:
        if name in self._changes:
            change = self._changes[name]
            if isinstance(change, property):
                return change.fget(self._original)
            return lambda *a, **k: change(self._original, *a, **k)
        return getattr(self._original, name)

    def __call__(self, *a: Any, **k: Any) -> Any:
        return self._changes["__call__"](self._original, *a, **k)


def laws(suite: object, skipped: tuple[str, ...] = ()) -> Mapping[str, Exception | None]:
    """What each law of a suite that needs no fixture says."""
    found: dict[str, Exception | None] = {}
    for name in dir(suite):
        if name.startswith("test_") and name not in skipped:
            try:
                getattr(suite, name)()
                found[name] = None
            except Exception as error:
                found[name] = error
    return found


def noticed(suite: object) -> bool:
    """Whether some law is red; the first one ends the search."""
    for name in dir(suite):
        if name.startswith("test_"):
            try:
                getattr(suite, name)()
            except Exception:
                return True
    return False


def first_row_off(values: np.ndarray, by: float = 1e-3) -> np.ndarray:
    """The same numbers but for the first row."""
    out = np.array(values, dtype=float)
    out[0] += by * (1.0 + np.abs(out[0]))
    return out


def log_off(log: Any, channel: str) -> Any:
    """A log with one channel off by a part in a million."""
    return log.put(log.channels[channel], log[channel] * (1.0 + 1e-6))
