"""Syntax trees of Python files: the tests of the house look at a thousand files, and share what they read."""

from __future__ import annotations

import ast
import gc
from collections.abc import Iterator
from functools import cache
from pathlib import Path

BLOCKS = ("body", "orelse", "finalbody", "handlers", "cases")


def statements(tree: ast.Module) -> Iterator[ast.AST]:
    """All of them, inside functions too. Expressions hold none: `ast.walk` spends its time in these."""
    left: list[ast.AST] = [tree]
    while left:
        node = left.pop()
        for block in BLOCKS:
            left += getattr(node, block, ())
        yield node


@cache
def tree(path: Path) -> ast.Module:
    """Of a file. All of its nodes stay: looks for garbage among them would take longer than the tests."""
    gc.disable()
    try:
        return ast.parse(path.read_text(encoding="utf-8"))
    finally:
        gc.freeze()
        gc.enable()


@cache
def imports_and_calls(path: Path) -> tuple[ast.Import | ast.ImportFrom | ast.Call, ...]:
    """Of a file, wherever they stand; most tests ask for them."""
    kinds = ast.Import | ast.ImportFrom | ast.Call
    return tuple(own for own in ast.walk(tree(path)) if isinstance(own, kinds))
