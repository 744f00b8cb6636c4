"""Which installed distribution the package `etude` belongs to.

Other projects on the package index use the name `etude` and install a package `etude` (`etude-sdk`).
Installed into one environment, their files and ours share one folder and pip warns of nothing:
docs/decisions/0048-name-on-the-index.md.
"""

from __future__ import annotations

import re

OURS = "etude"
NEXT_STEP = "Install Étude into an environment of its own: python3 -m venv .venv && .venv/bin/pip install ."


def strangers() -> list[str]:
    """Other installed distributions whose files lie in the package `etude`: "etude-sdk 0.2.6".

    The list of files (RECORD) tells, since the name of a distribution does not say which packages it has.
    """
    from importlib import metadata  # here: every command imports this module, few need it

    found = []
    for own in metadata.distributions():
        name = re.sub(r"[-_.]+", "-", own.name or "").lower()  # as PEP 503 compares names
        if name != OURS and f"\n{OURS}/" in f"\n{own.read_text('RECORD') or ''}":
            found.append(f"{own.name} {own.version}")
    return sorted(found)


def conflict() -> str:
    """One sentence on who else installed a package `etude` here; "" if nobody did."""
    found = strangers()
    if not found:
        return ""
    names = ", ".join(found)
    return f"another distribution here installs a package etude too ({names}): its files lie over ours"
