"""Additions to a model file: the mounting of the base, and the payload of the arm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from etude.errors import UsageError
from etude.types import Array

if TYPE_CHECKING:
    from etude_arm.loading.joint_choice import Moving

Three = tuple[float, float, float]
Six = tuple[float, float, float, float, float, float]
SIZES = {"box": 3, "cylinder": 2, "sphere": 1, "none": 0}


@dataclass(frozen=True)
class Mounting:
    """Pose of the file's base in the room, whose z points up: position in m, roll, pitch and yaw in rad."""

    position: Three = (0.0, 0.0, 0.0)
    rotation: Three = (0.0, 0.0, 0.0)

    @property
    def turn(self) -> Array:
        """(3, 3)."""
        from etude_arm.loading.rotations import turn_of

        return turn_of(*self.rotation)


@dataclass(frozen=True, kw_only=True)
class Attached:
    """A tool or a payload: mass and shape, fixed to a link.

    Attributes:
        mass: kg.
        centre: (3,) of mass, m in the link's frame.
        inertia: about the centre, along the link's axes: xx, yy, zz, xy, xz, yz, kg m^2; None: that of a
            homogeneous body of the shape.
        shape: "box", "cylinder" (along its z), "sphere", or "none".
        size: of a box its three sides; of a cylinder radius and length; of a sphere its radius; m.
        shape_centre: (3,) m in the link's frame; None: the centre of mass.
        rotation: of the shape, roll, pitch and yaw in the link's frame, rad.
        link: that carries it; "": the one that the last axis moves.
    """

    mass: float
    centre: Three = (0.0, 0.0, 0.0)
    inertia: Six | None = None
    shape: Literal["box", "cylinder", "sphere", "none"] = "none"
    size: tuple[float, ...] = ()
    shape_centre: Three | None = None
    rotation: Three = (0.0, 0.0, 0.0)
    link: str = ""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.mass) and self.mass > 0):
            raise UsageError(f"a mass of {self.mass:g} kg is not possible", where="mass")
        if len(self.size) != SIZES[self.shape] or not all(math.isfinite(s) and s > 0 for s in self.size):
            raise UsageError(
                f"a {self.shape} has {SIZES[self.shape]} sizes above zero, not {list(self.size)}",
                where="size",
                next_step="box: [x, y, z]; cylinder: [radius, length]; sphere: [radius]; in m.",
            )
        if self.inertia is None and self.shape == "none":
            raise UsageError(
                "there is a mass, but neither an inertia nor a shape that gives one",
                where="inertia",
                next_step='State shape = "box" and size, or inertia = [xx, yy, zz, xy, xz, yz] in kg m^2.',
            )
        from etude_arm.loading.inertia import possible

        moments = self.moments()
        if possible(moments) is not moments:
            raise UsageError(
                f"no body can have this inertia: {list(self.inertia or ())}",
                where="inertia",
                next_step="Each principal moment must be positive, and at most the sum of the others (kg "
                "m^2).",
            )

    def moments(self) -> Array:
        """(3, 3) inertia about the centre of mass."""
        from etude_arm.loading.inertia import ENTRIES
        from etude_arm.loading.rotations import turn_of

        if self.inertia is not None:
            inertia = np.zeros((3, 3))
            for value, (_, i, j) in zip(self.inertia, ENTRIES, strict=True):
                inertia[i, j] = inertia[j, i] = value
            return inertia
        turn, off = turn_of(*self.rotation), np.subtract(self.shape_centre or self.centre, self.centre)
        steiner = off @ off * np.eye(3) - np.outer(off, off)
        return np.asarray(
            self.mass * (turn @ np.diag(_homogeneous(self.shape, self.size)) @ turn.T + steiner)
        )


def _homogeneous(shape: str, size: tuple[float, ...]) -> Array:
    """Principal moments of a homogeneous body by mass."""
    if shape == "box":
        squares = np.square(size)
        # m (a² + b²) / 12
        return np.asarray((squares.sum() - squares) / 12)
    if shape == "sphere":
        # 2/5 m r²
        return np.full(3, 0.4 * size[0] ** 2)
    radius, length = size
    # a cylinder: m (3 r² + l²) / 12 across its axis, m r² / 2 about it
    across = (3 * radius**2 + length**2) / 12
    return np.array([across, across, radius**2 / 2])


def tip(moving: Sequence[Moving], joints: Sequence[str], what: str) -> str:
    """The last chosen joint: the one that carries no other chosen joint.

    Raises:
        UsageError: there are several, so that the link has to be named.
    """
    before = {joint.name: joint.before for joint in moving}
    carrying = set()
    for name in joints:
        while name := before[name]:
            carrying.add(name)
    tips = [name for name in joints if name not in carrying]
    if len(tips) > 1:
        raise UsageError(
            f"the arm ends at several joints: {', '.join(tips)}",
            where=f"[{what}]",
            next_step="Name the link that carries it: link = ...",
        )
    return tips[0]


@dataclass(frozen=True)
class Additions:
    """What is added to the model of a file: the mounting, and tool and payload by name in `carried`."""

    mounting: Mounting | None = None
    carried: tuple[tuple[str, Attached], ...] = ()

    def unverified(self) -> tuple[str, ...]:
        """Sentences on what a certificate does not verify."""
        none = [name for name, one in self.carried if one.shape == "none"]
        return tuple(f"the shape of the {name}: none is given" for name in none)
