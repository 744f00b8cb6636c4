"""Pairs of links that an SRDF beside a URDF disables: MoveIt's word that they may touch.

They are taken as leave, not as order: many files disable pairs that can well be kept apart (a hand and the
link two joints before it), or whatever was never seen to collide in a few thousand poses.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from etude.errors import UsageError

NEVER = "Never"
"""The reason of pairs that were not seen to collide: that is no leave to do so."""

Pairs = frozenset[frozenset[str]]


def disabled(model_file: Path) -> Pairs:
    """Pairs of links that the SRDF of a model file disables, but for those that never collide.

    Raises:
        UsageError: there is one and it is no XML.
    """
    path = next((path for path in _places(model_file) if path.is_file()), None)
    if path is None:
        return frozenset()
    try:
        root = ET.parse(path).getroot()
    except (OSError, ET.ParseError) as problem:
        raise UsageError(
            f"not a readable SRDF: {problem}", where=str(path), next_step="Correct it, or move it away."
        ) from None
    found = [one for one in root.iter("disable_collisions") if one.get("reason") != NEVER]
    return frozenset(frozenset((one.get("link1", ""), one.get("link2", ""))) for one in found)


def _places(model_file: Path) -> list[Path]:
    """Beside the file, and in the folder srdf next to its own."""
    name = model_file.with_suffix(".srdf").name
    return [model_file.parent / name, model_file.parent.parent / "srdf" / name]
