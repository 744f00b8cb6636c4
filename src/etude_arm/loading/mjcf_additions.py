"""Mounting, tool and payload in an MJCF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable

import numpy as np

from etude.types import Array
from etude_arm.loading.attached import Attached, Mounting
from etude_arm.loading.inertia import ENTRIES
from etude_arm.loading.rotations import turn_of


def mounted(world: ET.Element, mounting: Mounting) -> ET.Element:
    """The frame in the world that everything of the robot belongs into."""
    return ET.SubElement(world, "frame", pos=_text(mounting.position), quat=_text(_quaternion(mounting.turn)))


def add_carried(body: ET.Element, name: str, one: Attached) -> None:
    """Adds a tool or payload, under a name that no body has, to the body that carries it."""
    new, moments = ET.SubElement(body, "body", name=name), one.moments()
    full = _text(moments[i, j] for _, i, j in ENTRIES)
    ET.SubElement(new, "inertial", pos=_text(one.centre), mass=repr(one.mass), fullinertia=full)
    if one.shape != "none":
        radius, *length = one.size
        half = [value / 2 for value in one.size] if one.shape == "box" else [radius, *(x / 2 for x in length)]
        geom = ET.SubElement(new, "geom", name=f"{name}#0", type=one.shape, size=_text(half))
        geom.set("pos", _text(one.shape_centre or one.centre))
        geom.set("quat", _text(_quaternion(turn_of(*one.rotation))))


def _quaternion(turn: Array) -> Array:
    import mujoco

    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, turn.reshape(-1))
    return quat


def _text(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
