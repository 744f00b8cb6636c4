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


def compiled_part(function: Any, **options: Any) -> Any:
    """`njit` for a function that only compiled functions of its file call; a call from Python would crash.

    Its Python wrapper and its file in the cache would take a quarter of the compilation.
    """
    options |= {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return njit(**options)(function)
