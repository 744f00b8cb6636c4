"""Errors about logs: each says what to do next."""

from __future__ import annotations

import ast
from pathlib import Path

from syntax_trees import imports_and_calls

SOURCE = Path(__file__).parents[2] / "src"
NUMERIC = ("etude/models", "etude_sparse", "etude_online/learner.py")
"""Code that is called with arrays: its errors are those of programs."""


def test_every_error_about_a_log_says_what_to_do_next() -> None:
    found = [
        f"{path.relative_to(SOURCE)}:{call.lineno}"
        for path in sorted(SOURCE.rglob("*.py"))
        if not path.relative_to(SOURCE).as_posix().startswith(NUMERIC)
        for call in imports_and_calls(path)
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "DataError"
        if not any(keyword.arg in ("next_step", None) for keyword in call.keywords)
    ]
    assert found == []
