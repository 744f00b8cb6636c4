"""Compiled loops: numba, with its cache on disk where a folder is writable."""

from __future__ import annotations

from typing import Any

from numba import njit


def compiled(function: Any, **options: Any) -> Any:
    """`njit` with these options, cached; where no folder is writable numba raises, and there is no cache."""
    try:
        return njit(cache=True, **options)(function)
    except RuntimeError:
        return njit(**options)(function)
