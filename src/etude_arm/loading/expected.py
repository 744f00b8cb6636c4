"""What a description says of its robot at one pose, evaluated apart from the model that is compiled of it.

`urdf_expected` and `mjcf_expected` make it, `agreement` holds the compiled model against it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from etude.types import Array, Index, Mask

SEED = 29
"""Of the pose: the same in every run, and no pose that a file was made for."""
ANGLE, STROKE = 2.0, 0.2
"""rad and m to both sides of 0; the joints' limits do not matter to a comparison."""


@dataclass(frozen=True, eq=False)
class Place:
    """A shape in the room.

    Attributes:
        kind: "mesh" or MuJoCo's word. centre: (3,) m, of a mesh its file's origin. turn: (3, 3).
        size: half of a box's sides; radius, of a cylinder or capsule then half its length; m; () of others.
        needed: whether a model without it lacks something.
    """

    kind: str
    centre: Array
    turn: Array
    size: tuple[float, ...] = ()
    needed: bool = False


@dataclass(frozen=True, eq=False)
class Expected:
    """At the pose q (J,); everything in the frame of the room, whose z points up, in SI.

    Attributes:
        q: the pose, rad (m). joints: names; slides: (J,) which of them slide.
        gravity: (3,). base: (4, 4) pose of the description's base.
        anchor, axis: (J, 3) of each joint. frame: (J, 4, 4) of the link or body that it moves.
        moves: (J, J) whether joint j moves what joint i moves, at [i, j].
        mass, centre: (J,) and (J, 3) of what moves as one with each joint, with tool and payload.
        inertia: (J, 3, 3) about the centre; NaN where the file's own is none that a body can have.
        carried: what -> kg: tool and payload, which `mass` contains.
        shapes: link or body, tool or payload -> the places that its shapes may have.
    """

    q: Array
    joints: tuple[str, ...]
    slides: Mask
    gravity: Array
    base: Array
    anchor: Array
    axis: Array
    frame: Array
    moves: Mask
    mass: Array
    centre: Array
    inertia: Array
    carried: Mapping[str, float]
    shapes: Mapping[str, tuple[Place, ...]]

    @property
    def weight(self) -> Array:
        """(J,) torques and forces that hold the robot up at q, N m (N): from masses and levers alone."""
        found = np.zeros(len(self.joints))
        for j, (axis, anchor) in enumerate(zip(self.axis, self.anchor, strict=True)):
            for i in np.flatnonzero(self.moves[:, j]):
                pull = self.mass[i] * self.gravity
                lever = np.cross(self.centre[i] - anchor, pull)
                found[j] -= axis @ (pull if self.slides[j] else lever)
        return found


def pose_of_joints(slides: Mask) -> Array:
    """(J,) the pose at which models are compared."""
    even = np.random.default_rng(SEED).uniform(-1.0, 1.0, len(slides))
    return np.asarray(even * np.where(slides, STROKE, ANGLE))


def gathered(parts: list[tuple[int, float, Array, Array]], joints: int) -> tuple[Array, Array, Array]:
    """Mass (J,), centre (J, 3) and inertia (J, 3, 3) about it of each joint's part, of bodies.

    Args:
        parts: joint, kg, centre (3,) and inertia about it (3, 3), the last two in the frame of the room.
        joints: J.
    """
    mass, moment = np.zeros(joints), np.zeros((joints, 3))
    for j, kg, at, _ in parts:
        mass[j] += kg
        moment[j] += kg * at
    centre = moment / np.maximum(mass, np.finfo(float).tiny)[:, None]
    inertia = np.zeros((joints, 3, 3))
    for j, kg, at, own in parts:
        away = at - centre[j]
        inertia[j] += own + kg * (away @ away * np.eye(3) - np.outer(away, away))
    return mass, centre, inertia


def chain_matrix(before: Index) -> Mask:
    """(J, J) `moves` of the joint that carries each, -1 at the base."""
    moves = np.eye(len(before), dtype=np.bool_)
    for i in range(len(before)):
        at = int(before[i])
        while at >= 0:
            moves[i, at] = True
            at = int(before[at])
    return moves
