"""Lazy package faces: names that are imported from a room's modules when they are first used.

A room's `__init__` imports them under TYPE_CHECKING, where type checkers see them, and lists them in
`__all__`. The same imports say here where each is.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from functools import cache
from typing import Any


def face(room: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a package; room: its `__name__`."""

    def load(name: str) -> Any:
        return loaded(room, name)

    def listed() -> list[str]:
        return sorted({*vars(sys.modules[room]), *sys.modules[room].__all__})

    return load, listed


def loaded(room: str, name: str) -> Any:
    """Object of a room by name. AttributeError: the name is not in `__all__`."""
    package = sys.modules[room]
    if name not in package.__all__:
        raise AttributeError(f"module {room!r} has no attribute {name!r}")
    module = places(room)[name]
    if module == room:
        return importlib.import_module(f"{room}.{name}")
    value = vars(importlib.import_module(module))[name]
    setattr(package, name, value)
    return value


@cache
def places(room: str) -> dict[str, str]:
    """Name -> module, by the room's imports under TYPE_CHECKING."""
    import ast
    import inspect

    tree = ast.parse(inspect.getsource(sys.modules[room]))
    guarded = (part for node in tree.body if isinstance(node, ast.If) for part in node.body)
    imports = (part for part in guarded if isinstance(part, ast.ImportFrom))
    return {alias.name: statement.module or "" for statement in imports for alias in statement.names}
