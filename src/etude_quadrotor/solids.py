"""Solid parts of a multirotor for pictures in space: arms, a disc for each rotor, and a nose along x."""

from __future__ import annotations

import math

import numpy as np

from etude.types import CUBE, Array, Index, Motion, Solid
from etude_quadrotor.spec import QuadrotorSpec
from etude_quadrotor.vehicle import CORNERS, GRAVITY

ARM = 0.17
"""m from the centre to a rotor where nobody described the vehicle."""
SIDES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
TRIANGLES = np.array([[a, *pair] for a, b, c, d in SIDES for pair in ((b, c), (c, d))])
"""Of the corners of `CUBE`."""
DISC = 16  # corners of a rotor's disc


def solids(spec: QuadrotorSpec) -> tuple[Solid, ...]:
    """One part, because everything but the rotors is fixed to the body."""
    if spec.airframe is not None:
        rotors = spec.airframe.rotors
    else:
        rotors = np.array(spec.rotors)[:, :2] if spec.rotors else np.array(CORNERS) * ARM / math.sqrt(2.0)
    arm = float(np.linalg.norm(rotors, axis=1).max())
    width, radius = 0.06 * arm, 0.45 * arm
    parts = [_bar(np.zeros(2), rotor, width) for rotor in rotors]
    parts += [_disc(rotor, radius, width) for rotor in rotors]
    parts.append(_bar(np.zeros(2), np.array([0.7 * arm, 0.0]), 2.5 * width))
    first = np.cumsum([0, *(len(points) for points, _ in parts[:-1])])
    faces = [triangles + start for (_, triangles), start in zip(parts, first, strict=True)]
    return (Solid("vehicle", np.concatenate([points for points, _ in parts]), np.concatenate(faces)),)


def placed(motion: Motion) -> Array:
    """Frames (T, 1, 3, 4) of a vehicle whose thrust gives the acceleration without drag, at heading zero.

    Level where accelerations are unknown.
    """
    thrust = np.zeros_like(motion.orders[0])
    thrust[:, 2] = GRAVITY
    if len(motion.orders) > 2:
        thrust = thrust + motion.orders[2]
    up = thrust / np.linalg.norm(thrust, axis=1, keepdims=True)
    ahead = np.cross([0.0, 1.0, 0.0], up)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    return np.stack([ahead, np.cross(up, ahead), up, motion.orders[0]], axis=-1)[:, None]


def _bar(start: Array, end: Array, width: float) -> tuple[Array, Index]:
    """A flat bar between two points (2,) of the plane of the rotors."""
    along = end - start
    across = np.array([-along[1], along[0]]) / np.linalg.norm(along) * 0.5 * width
    x, y = 0.5 * (CUBE[:, :1] + 1.0) * along, CUBE[:, 1:2] * across
    return np.column_stack([start + x + y, 0.25 * width * CUBE[:, 2]]), TRIANGLES


def _disc(centre: Array, radius: float, height: float) -> tuple[Array, Index]:
    """Disc of a rotor with both sides, above the arms."""
    angles = 2.0 * math.pi * np.arange(DISC) / DISC
    ring = centre + radius * np.column_stack([np.cos(angles), np.sin(angles)])
    points = np.column_stack([np.concatenate([centre[None], ring]), np.full(DISC + 1, height)])
    k = np.arange(DISC)
    upper = np.column_stack([np.zeros(DISC, dtype=np.int64), k + 1, (k + 1) % DISC + 1])
    return points, np.concatenate([upper, upper[:, ::-1]])
