"""Payload table of a robot file, with an identified load."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np

from etude.errors import UsageError
from etude.toml_tables import write_values
from etude.types import Array
from etude_arm.loading.attachments import Attached
from etude_arm.loading.inertia import ENTRIES
from etude_arm.spec import ArmSpec

BALL = 0.05  # m
"""Radius of the ball that stands for a load of which only mass and centre are known."""
PUT_DOWN = 0.05
"""Part of a payload that may be left of it, where it was put down."""


def with_payload(text: str, spec: ArmSpec, mass: float, centre: Array) -> str:
    """The robot file with a load (kg, m in the frame of the last axis's link) added to its payload.

    Raises:
        UsageError: the removed mass exceeds the robot's payload, or that payload is at another link.
    """
    old = spec.payload
    parts = [(mass, centre, np.eye(3) * 0.4 * mass * BALL**2)]
    if old is not None:
        if old.link:
            raise UsageError(
                f"the payload is at link '{old.link}', but the estimated load is at the link of the last "
                "axis",
                where="[payload]",
                next_step="Correct mass and centre by hand.",
            )
        parts.append((old.mass, np.array(old.centre), old.moments()))
    total = float(sum(part[0] for part in parts))
    remainder = PATTERN.sub("", text).rstrip() + "\n"
    if old is not None and abs(total) <= PUT_DOWN * old.mass:
        return remainder
    if total <= 0.0:
        raise UsageError(
            f"{-mass:.3g} kg were removed, but the robot file states only {total - mass:.3g} kg",
            where="[payload]",
            next_step="Correct mass or tool by hand.",
        )
    middle = np.sum([m * c for m, c, _ in parts], axis=0) / total
    full = np.eye(3) * 0.4 * total * BALL**2
    if mass > 0.0:  # of what is left the shape is not known
        away = [(m, c - middle, moments) for m, c, moments in parts]
        full = np.sum([moments + m * (d @ d * np.eye(3) - np.outer(d, d)) for m, d, moments in away], axis=0)
    x, y, z = middle.tolist()
    xx, yy, zz, xy, xz, yz = (float(full[i, j]) for _, i, j in ENTRIES)
    inertia = (xx, yy, zz, xy, xz, yz)
    shape = old or Attached(mass=total, inertia=inertia)
    place = shape.shape_centre or (shape.centre if shape.shape != "none" else None)
    new = replace(shape, mass=total, centre=(x, y, z), inertia=inertia, shape_centre=place)
    return remainder + "\n" + write_values(_Payload(new)).lstrip()


PATTERN = re.compile(r"^\[payload\][^\n]*\n(?:(?!\[).*\n?)*", re.MULTILINE)
"""The table [payload], up to the next one."""


@dataclass(frozen=True)
class _Payload:
    payload: Attached
