"""What people would rather look at than read: pictures of objects, drawn by the report's own pen.

Objects know only their noun; who draws it stands in the group "etude.pictures" of `plugins`, ranks above.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from etude.plugins import load
from etude.storage import write_atomic

GROUP = "etude.pictures"


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


def picture_of(noun: str, thing: Any, path: str | Path | None = None) -> Picture:
    """The picture of `thing`, saved as well if there is a path."""
    drawn = Picture(load(GROUP, noun)(thing))
    if path is not None:
        drawn.save(path)
    return drawn
