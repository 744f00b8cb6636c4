"""Boxes, cylinders and spheres of a URDF, checked before MuJoCo sees them, whose words name no line of it."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from etude.errors import UsageError
from etude_arm.loading.urdf_checks import numbers

SIZES = {
    "box": {"size": 3},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
}
"""Attributes of each, and how many numbers each has, m."""


def check_primitive(shape: ET.Element, place: str) -> None:
    """Raises a UsageError if a <geometry>'s child is no known shape, or a size of it is none."""
    if shape.tag not in SIZES:
        raise UsageError(
            f"a shape <{shape.tag}> is not known",
            where=place,
            next_step=f"URDF has {', '.join(SIZES)} and mesh: correct it, or take it out.",
        )
    for key, count in SIZES[shape.tag].items():
        found = numbers(shape.get(key), "", place)
        if len(found) != count or not (np.all(np.isfinite(found)) and np.all(found > 0.0)):
            raise UsageError(
                f"a {shape.tag} cannot have {key}={shape.get(key)!r}",
                where=place,
                next_step=f"Give {count} number{'s' if count > 1 else ''} above zero, in m.",
            )
