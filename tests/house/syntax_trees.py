"""Statements of Python files, quickly: the tests of the house look at a thousand files."""

from __future__ import annotations

import ast
from collections.abc import Iterator

BLOCKS = ("body", "orelse", "finalbody", "handlers", "cases")


def statements(tree: ast.Module) -> Iterator[ast.AST]:
    """All of them, inside functions too. Expressions hold none: `ast.walk` spends its time in these."""
    left: list[ast.AST] = [tree]
    while left:
        node = left.pop()
        for block in BLOCKS:
            left += getattr(node, block, ())
        yield node
