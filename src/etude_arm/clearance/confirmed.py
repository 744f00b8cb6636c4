"""Distances on nobody's word: two shapes on both sides of a slab are at least as far apart as it is thick.

A solver that is right in all but one of some thousand poses is not enough for a proof: MuJoCo 4.0.0 sometimes
gives a few millimetres for a capsule deep inside another shape. So before a motion counts as proved, each
distance that it rests on is held against the slab across the direction that the solver itself names. Shapes
whose spheres are far apart need no slab. An ellipsoid has no corners: its distances are taken as they are.
"""

from __future__ import annotations

import numpy as np

from etude.types import Array, Mask
from etude_arm.clearance.gaps import CUTOFF, TOLERANCE, Gaps
from etude_arm.clearance.tracked import Scene


def excess(gaps: Gaps, poses: Array) -> Array:
    """(T, n) m by which distances at poses (T, k) are larger than what a slab confirms; 0 if confirmed."""
    distances = gaps.of_poses(poses)
    found = np.zeros_like(distances)
    count = len(gaps.sensed)
    if not count:
        return found
    scene = Scene.of(gaps, poses, np.zeros((len(poses), count), dtype=np.bool_))
    doubted = (distances[:, :count] > 0.0) & ~_far(gaps, scene)
    scene = Scene.of(gaps, poses, doubted)
    still = np.zeros(len(gaps.skeleton.joints))
    for i in np.flatnonzero(doubted.any(axis=0)):
        at = np.flatnonzero(doubted[:, i])
        short = distances[at, i] - scene.least(int(i), at, still)
        found[at, i] = np.where(short > TOLERANCE, short, 0.0)
    return found


def _far(gaps: Gaps, scene: Scene) -> Mask:
    """(T, number of gaps between geoms) where spheres around both are farther apart than anybody looks."""
    shapes = gaps.skeleton.shapes
    centres, sizes = [], []
    for shape in shapes:
        middle = 0.5 * (shape.points.min(axis=0) + shape.points.max(axis=0))
        sizes.append(np.linalg.norm(shape.points - middle, axis=1).max() + shape.radius)
        centres.append(scene.turns[:, shape.geom] @ middle + scene.places[:, shape.geom])
    pairs = [(gap.one, gap.other) for gap in gaps.sensed]
    apart = [np.linalg.norm(centres[a] - centres[b], axis=1) - sizes[a] - sizes[b] for a, b in pairs]
    smooth = [shapes[a].smooth or shapes[b].smooth for a, b in pairs]
    return np.asarray((np.stack(apart, axis=1) >= CUTOFF) | np.array(smooth))
