"""Repair of physically impossible inertias, each named in a message.

The principal moments of a body are positive, and none exceeds the sum of the other two. Files violate both
rules: zeros for empty frames, rounded figures, typing errors. MuJoCo refuses such a file.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from etude.errors import UsageError
from etude.types import Array
from etude_arm.loading.urdf_tree import UrdfTree, number, vector

if TYPE_CHECKING:
    pass

SMALLEST = 1e-9
"""kg m^2: least principal moment; smaller ones are raised to it."""
NO_MASS = 1e-6  # kg
NO_MASSES = (
    "The model file gives no masses (<inertial>): only joints and shapes are used, and forces are "
    "learned from logs alone. Before that, motions are not checked against command limits, and no "
    "rehearsal is possible."
)
ENTRIES = (("ixx", 0, 0), ("iyy", 1, 1), ("izz", 2, 2), ("ixy", 0, 1), ("ixz", 0, 2), ("iyz", 1, 2))


@dataclass(frozen=True)
class Masses:
    """Valid <inertial> elements of the moving links, and a sentence for each repair or doubt."""

    elements: Mapping[str, ET.Element]
    notes: tuple[str, ...]


def possible(inertia: Array) -> Array:
    """The inertia (3, 3) itself if it is physically possible, else the repaired one.

    Eigenvalues are raised to SMALLEST. Then all three are raised by one amount until the largest is at most
    the sum of the others, as a small spherical shell of mass would do.
    """
    moments, axes = np.linalg.eigh(inertia)
    lifted = np.maximum(moments, SMALLEST)
    excess = float(lifted[2] - lifted[0] - lifted[1])
    if excess > 0:
        # 1e-9 more, since MuJoCo refuses a moment that rounding leaves above the sum
        lifted = lifted + excess + 1e-9 * lifted[2]
    if np.array_equal(lifted, moments):
        return inertia
    return np.asarray(axes @ np.diag(lifted) @ axes.T)


def masses_of(tree: UrdfTree, joints: Sequence[str]) -> Masses:
    """The masses of all moving links; empty if the file has none. Those of the base do not matter.

    Raises:
        UsageError: a mass is negative or not a number.
    """
    elements: dict[str, ET.Element] = {}
    repaired, empty = [], []
    clusters = tree.clusters(joints)[1:]
    for cluster in clusters:
        carried = 0.0
        for name in cluster:
            inertial = tree.links[name].find("inertial")
            if inertial is not None:
                element, mass, old = _sound(inertial, f"{tree.where}, link '{name}'")
                if mass < NO_MASS:  # a frame with an empty <inertial>
                    continue
                elements[name] = element
                carried += mass
                repaired += [f"'{name}' ({mass:.4g} kg, {old})"] if old else []
        empty += [] if carried > 0 else [cluster[0]]
    if len(empty) == len(clusters):
        return Masses({}, (NO_MASSES,))
    notes = []
    if empty:
        notes.append(f"No mass is given for the part that {', '.join(empty)} carries: check this.")
    if repaired:
        notes.append(f"Physically impossible inertias were repaired: {'; '.join(repaired)}.")
    return Masses(elements, tuple(notes))


def _sound(inertial: ET.Element, place: str) -> tuple[ET.Element, float, str]:
    """A new <inertial>, its mass, and the old moments if they had to be repaired."""
    element = inertial.find("mass")
    mass = 0.0 if element is None else number(element.get("value", "0"), place)
    if not 0.0 <= mass < np.inf:
        raise UsageError(f"a mass cannot be {mass:g} kg", where=place, next_step="Correct the model file.")
    stated, inertia = inertial.find("inertia"), np.zeros((3, 3))
    for key, i, j in ENTRIES:
        value = 0.0 if stated is None else number(stated.get(key, "0"), place)
        inertia[i, j] = inertia[j, i] = value
    if not np.all(np.isfinite(inertia)):
        raise UsageError("an inertia is infinite", where=place, next_step="Correct the model file.")
    sound = possible(inertia)
    new = ET.Element("inertial")
    for origin in inertial.findall("origin"):
        for key in ("xyz", "rpy"):
            vector(origin.get(key), "0 0 0", place)
        new.append(origin)
    ET.SubElement(new, "mass", value=repr(mass))
    ET.SubElement(new, "inertia", {key: repr(float(sound[i, j])) for key, i, j in ENTRIES})
    old = ", ".join(f"{key} {inertia[i, j]:.3g}" for key, i, j in ENTRIES[:3])
    return new, mass, "" if sound is inertia else old
