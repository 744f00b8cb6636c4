"""Clear home pose of an arm: search for a pose far from everything, and for a box of nearly clear poses about
it.

No proof relies on them, because each motion is proved. A good home and box only allow larger motions.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from etude.types import Array, Mask
from etude_arm.clearance.distances import CUTOFF, Gaps

POSES = 2048
"""Number of random poses, of which the clearest becomes home."""
FAR = 0.12
"""m: larger distances of a pair count as this value."""
PULL = 0.25
"""Weight of the distance of home from the middle of the ranges, relative to the largest clearance."""
ROOM = 0.1
"""Part of its range that home keeps from a joint's ends, where other poses are as good. The margin for
tracking errors is a part of that distance, and next to an end the sag of the feedback exceeds it."""
STRAIN = 2.0
"""Weight of what rest takes beyond a drive's limit, with its assumed deviation, as a part of the limit."""
BOX_POSES = 512  # random poses that find a clear box; its motions are proved later
CLEAR = 0.999
"""Fraction of the box's poses that must be clear."""
SMALLER, LARGER = 0.75, 1.25  # factors of a side that is hit, and of one that is clear
ROUNDS = 3
"""Number of rounds in which each joint's side of the box is widened."""
HALF_TURN = math.pi
"""rad, largest half width of a hinge's box; a range of two turns would hide near obstacles."""
BOX_ROOM = 0.003
"""m, additional clearance of poses in the box, compared with motions, if home has it."""
LEAST_BOX = 0.02
"""Smallest side of a joint's box, as a fraction of its range."""


def clearest(gaps: Gaps, rng: np.random.Generator, weight: Callable[[Array], Array] | None = None) -> Array:
    """The pose (k,) near the middle with the widest gaps, each relative to its largest possible width; rad
    (m).

    Args:
        gaps: of the robot. rng: of the random poses.
        weight: poses (n, k) -> (n,) part of the drives' limits that rest takes; above 1 a pose is avoided.
    """
    low, high = gaps.skeleton.lower, gaps.skeleton.upper
    middle, width = 0.5 * (low + high), high - low
    poses = gaps.skeleton.random_poses(rng, POSES)
    poses = middle + rng.uniform(0.0, 1.0, (POSES, 1)) * (poses - middle)
    poses[0] = middle
    aside = (((poses - middle) / width) ** 2).sum(axis=1)
    room = (np.minimum(poses - low, high - poses) / width).min(axis=1)
    if not gaps.list:
        return middle
    distances = gaps.of_poses(poses)
    # 1 µm avoids division by zero for pairs that touch in every pose
    widest = np.clip(distances.max(axis=0), 1e-6, FAR)
    score = np.minimum(distances / widest, 1.0).min(axis=1) - PULL * aside
    score = score - np.maximum(1.0 - room / ROOM, 0.0)
    score = score if weight is None else score - STRAIN * np.maximum(weight(poses) - 1.0, 0.0)
    return np.asarray(poses[int(score.argmax())])


def box_about(gaps: Gaps, home: Array, margin: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Lower and upper ends (k,) of a box about home in which nearly all poses keep `margin` m.

    Gaps that are narrow at home keep half of their width there. The whole box shrinks until the gaps keep
    their margins. Then each joint's side in turn is widened while they keep them.
    """
    low, high, slides = gaps.skeleton.lower, gaps.skeleton.upper, gaps.skeleton.slides
    half = np.where(slides, 0.5 * (high - low), np.minimum(0.5 * (high - low), HALF_TURN))
    at_home = gaps.of_poses(home[None])[0]
    # half of a narrow gap is kept, and a quarter is left as room for searches
    required = np.minimum(margin, 0.5 * at_home) + np.minimum(BOX_ROOM, 0.25 * at_home)
    signs = rng.uniform(-1.0, 1.0, (BOX_POSES, len(home)))
    signs = np.sign(signs) * np.abs(signs) ** (1.0 / 3.0)  # more samples near corners, which are rarely clear

    def ends(part: Array) -> tuple[Array, Array]:
        return np.maximum(home - part * half, low), np.minimum(home + part * half, high)

    def clear(part: Array) -> bool:
        lower, upper = ends(part)
        poses = np.where(signs < 0.0, home + signs * (home - lower), home + signs * (upper - home))
        return float(clear_poses(gaps, poses, required).mean()) >= CLEAR

    part = _expanded(clear, _shrunk(clear, len(home)), rng)
    return ends(part)


def clear_poses(gaps: Gaps, poses: Array, required: Array) -> Mask:
    """(T,) whether every gap is at least `required` (n,) m wide, apart from gaps that never can be."""
    return np.asarray(np.all(gaps.of_poses(poses) >= np.minimum(required, CUTOFF), axis=1))


def _shrunk(clear: Callable[[Array], bool], size: int) -> Array:
    part = np.ones(size)
    while not clear(part) and part[0] > LEAST_BOX:
        part = SMALLER * part
    return part


def _expanded(clear: Callable[[Array], bool], part: Array, rng: np.random.Generator) -> Array:
    for _ in range(ROUNDS):
        for j in rng.permutation(len(part)):
            trial = part.copy()
            trial[j] = min(LARGER * part[j], 1.0)
            if trial[j] > part[j] and clear(trial):
                part = trial
    return part
