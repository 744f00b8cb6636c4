"""The face of a room: names that are loaded from its modules when they are first used."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping
from typing import Any


def face(room: str, places: Mapping[str, str]) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a package.

    Args:
        room: its `__name__`.
        places: name -> module of the room that defines it, or the whole name of a module elsewhere.
    """

    def load(name: str) -> Any:
        if name not in places:
            raise AttributeError(f"module {room!r} has no attribute {name!r}")
        module = places[name] if places[name].startswith("etude") else f"{room}.{places[name]}"
        found = vars(importlib.import_module(module))[name]
        setattr(sys.modules[room], name, found)
        return found

    def listed() -> list[str]:
        return sorted({*vars(sys.modules[room]), *places})

    return load, listed
