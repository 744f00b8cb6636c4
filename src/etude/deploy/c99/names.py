"""Names of people's joints as identifiers of C."""

from __future__ import annotations

import re
from collections.abc import Sequence

C = """auto break case char const continue default do double else enum extern float for goto if
inline int long register restrict return short signed sizeof static struct switch typedef union unsigned
void volatile
while bool main"""
CPP = """catch class delete explicit friend mutable namespace new operator private protected public
template this throw try typename using virtual"""
KEYWORDS = frozenset([*C.split(), *CPP.split()])


def identifier(name: str) -> str:
    """A name that C and C++ take: other characters than letters, digits and _ become _."""
    found = re.sub(r"[^A-Za-z0-9_]", "_", name)
    if not re.match(r"[A-Za-z]", found):
        found = f"n{found}" if found.startswith("_") else f"n_{found}"
    return f"{found}_" if found.lower() in KEYWORDS else found


def identifiers(names: Sequence[str]) -> list[str]:
    """The same of several, no two alike: a number is added where they would be."""
    found: list[str] = []
    for name in names:
        own, number = identifier(name), 2
        base = own
        while own.lower() in (known.lower() for known in found):
            own, number = f"{base}_{number}", number + 1
        found.append(own)
    return found


def renamed(names: Sequence[str], given: Sequence[str]) -> list[str]:
    """A line for each name that had to change."""
    return [f"{old!r} is {new} in C" for old, new in zip(names, given, strict=True) if old != new]
