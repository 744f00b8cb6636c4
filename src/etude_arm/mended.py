"""Which robots what earlier versions wrote is wrong for; see docs/known_faults.md."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from etude_arm.spec import ArmSpec

WORLD = "world"
"""The name of MuJoCo's own world body, which takes no pose: a root link of that name lost its mounting."""


def lost_mounting(spec: ArmSpec) -> bool:
    """Whether generation 1 lost the mounting of this robot: its URDF's root link is called world."""
    if spec.model_file is None or spec.mounting is None:
        return False
    if not any((*spec.mounting.position, *spec.mounting.rotation)):
        return False
    try:
        root = ET.parse(spec.model_file).getroot()
    except (OSError, ET.ParseError):
        return False
    below = {child.get("link") for child in root.iterfind("joint/child")}
    return root.tag == "robot" and any(
        link.get("name") == WORLD not in below for link in root.iterfind("link")
    )
