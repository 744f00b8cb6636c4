"""Arrays as static tables of C, each content once; numbers in full and in no locale."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

PER_LINE = 6


def numbers(values: Any, single: bool) -> list[str]:
    """Numbers that read back exactly: of a float the shortest that does."""
    if np.asarray(values).dtype.kind in "iub":
        return [str(int(value)) for value in np.ravel(values)]
    if single:
        return [f"{_pointed(str(np.float32(value)))}f" for value in np.ravel(values)]
    return [_pointed(repr(float(value))) for value in np.ravel(values)]


def _pointed(text: str) -> str:
    return text if any(c in text for c in ".e") else f"{text}.0"


def table(name: str, values: Any, single: bool, kind: str = "static const") -> str:
    """Its definition."""
    own = numbers(values, single)
    word = "int" if np.asarray(values).dtype.kind in "iub" else "real"
    rows = [", ".join(own[i : i + PER_LINE]) for i in range(0, len(own), PER_LINE)]
    lines = ",\n    ".join(rows)
    return f"{kind} {word} {name}[{len(own)}] = {{\n    {lines}}};\n"


def tables(data: Mapping[str, Any], single: bool) -> tuple[str, int]:
    """Definitions of all of them, equal ones as another name of the first; and their bytes."""
    known: dict[tuple[str, bytes], str] = {}
    text, size = [], 0
    for name, values in data.items():
        array = np.asarray(values)
        whole = array.dtype.kind in "iub"
        plain = array.astype(np.int64 if whole else np.float64).ravel()
        key = ("int" if whole else "real", plain.tobytes())
        if key in known:
            text.append(f"#define {name} {known[key]}\n")
            continue
        known[key] = name
        text.append(table(name, plain, single))
        size += plain.size * (4 if whole or single else 8)
    return "".join(text), size


def finite(data: Mapping[str, Any]) -> bool:
    """Whether every number of them is one."""
    return all(bool(np.isfinite(np.asarray(values, dtype=float)).all()) for values in data.values())
