"""What is asked for again and again: made once, up to a number of things, then all of it is forgotten."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")
MOST = 256
"""Motions: a certificate asks each limit for the same proof several times."""


def remembered(store: dict[str, T], key: str, make: Callable[[], T], most: int = MOST) -> T:
    """The value of `key` in `store`, made if it is not there; a full store is emptied first."""
    if key not in store:
        if len(store) >= most:
            store.clear()
        store[key] = make()
    return store[key]
