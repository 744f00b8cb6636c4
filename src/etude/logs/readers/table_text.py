"""Names as cells of tables in text: quoted where a separator could be seen in them, and no formula for a
spreadsheet, which runs a cell that begins as one.
"""

from __future__ import annotations

from collections.abc import Iterable

FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""How a formula begins, as OWASP lists it under "CSV Injection"."""
AS_TEXT = "'"
"""Before a cell it says that what follows is text."""
SEPARATING = ",;|'\"\t "


def text_cell(text: str) -> str:
    """A cell of CSV that `restored`, or any reader of quoted cells, gives back."""
    own = AS_TEXT + text if text.startswith((*FORMULA, AS_TEXT)) else text
    return '"{}"'.format(own.replace('"', '""')) if any(c in own for c in SEPARATING) else own


def header_row(names: Iterable[str]) -> str:
    """A line of names."""
    return ",".join(map(text_cell, names)) + "\n"


def restored(text: str) -> str:
    """The name that `text_cell` wrote, of a cell without its quotes."""
    begins = text.startswith(AS_TEXT) and text[1:].startswith((*FORMULA, AS_TEXT))
    return text[1:] if begins else text
