"""Pictures of objects (`.plot()`), drawn by the functions that draw the report's figures.

An object names its kind; the function that draws it is imported when a picture is asked for, since the report
stands above all objects.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from etude.storage import write_atomic

DRAWN_BY: Mapping[str, str] = {
    kind: f"etude.report.pictures:of_{kind}" for kind in ("campaign", "log", "trajectory")
}
"""Kind of an object -> "module:function" that draws it."""


@dataclass(frozen=True, repr=False)
class Picture:
    """A drawing: a notebook shows it; `save` writes it to a file."""

    svg: str

    def _repr_svg_(self) -> str:
        return self.svg

    def __repr__(self) -> str:
        return f"Picture ({len(self.svg)} characters of SVG; .save('picture.svg') keeps it)"

    def save(self, path: str | Path) -> Path:
        """Writes the SVG file, whole or not at all, and returns its path."""
        write_atomic(Path(path), self.svg.encode("utf-8"))
        return Path(path)


def picture_of(kind: str, thing: Any, path: str | Path | None = None) -> Picture:
    """The picture of `thing`, saved as well if there is a path."""
    module, _, function = DRAWN_BY[kind].partition(":")
    drawn = Picture(getattr(importlib.import_module(module), function)(thing))
    if path is not None:
        drawn.save(path)
    return drawn
