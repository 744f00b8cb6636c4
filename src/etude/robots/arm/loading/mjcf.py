"""An MJCF, as MuJoCo loads it, with the chosen joints alone."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path

from etude.robots.arm.loading.loaded import Loaded


def load_mjcf(
    root: ET.Element, path: Path, wanted: Sequence[str] | None, given: Mapping[str, float]
) -> Loaded:
    """`load.load` of an MJCF."""
    raise NotImplementedError(path, root, wanted, given)
