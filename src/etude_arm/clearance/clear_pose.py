"""The search for a clear home: a pose far from everything, and a box about it that is nearly all clear.

Neither is trusted: motions are proved one by one. A good home and box only leave much of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from etude.types import Array, Mask
from etude_arm.clearance.distances import CUTOFF, Gaps

POSES = 2048
"""Random ones, of which the clearest is home."""
FAR = 0.12
"""m: a pair that can be farther apart than this is not the better for it."""
PULL = 0.25
"""Of a home towards the middle of the ranges, in parts of the largest clearance."""
BOX_POSES = 512  # random poses that find a clear box; its motions are proved later
CLEAR = 0.999
"""Part of the box's poses that are clear."""
SMALLER, LARGER = 0.75, 1.25  # factors of a side that is hit, and of one that is clear
ROUNDS = 3
"""In which each joint's part of the box is widened."""
HALF_TURN = math.pi
"""rad: a hinge's box is no wider than this to either side; a range of two turns would hide what is near."""
BOX_ROOM = 0.003
"""m, by which poses of the box are clearer than motions have to be, if home is."""
LEAST_BOX = 0.02
"""Part of its range below which a joint's box is not made smaller."""


def clearest(gaps: Gaps, rng: np.random.Generator) -> Array:
    """(k,) the pose whose gaps are widest, each in parts of what it can be, and which is near the middle."""
    low, high = gaps.skeleton.lower, gaps.skeleton.upper
    middle, width = 0.5 * (low + high), high - low
    poses = gaps.skeleton.random_poses(rng, POSES)
    poses = middle + rng.uniform(0.0, 1.0, (POSES, 1)) * (poses - middle)
    poses[0] = middle
    aside = (((poses - middle) / width) ** 2).sum(axis=1)
    if not gaps.list:
        return middle
    distances = gaps.of_poses(poses)
    # 1 µm: pairs that touch in every pose divide by something
    widest = np.clip(distances.max(axis=0), 1e-6, FAR)
    score = np.minimum(distances / widest, 1.0).min(axis=1) - PULL * aside
    return np.asarray(poses[int(score.argmax())])


def box_about(gaps: Gaps, home: Array, margin: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """(k,) lower and upper ends of a box about home of which nearly all poses keep `margin` m.

    Gaps that are narrow at home keep half of that. The box shrinks as a whole until they do; then each joint
    in turn is widened as long as they still do.
    """
    low, high, slides = gaps.skeleton.lower, gaps.skeleton.upper, gaps.skeleton.slides
    half = np.where(slides, 0.5 * (high - low), np.minimum(0.5 * (high - low), HALF_TURN))
    at_home = gaps.of_poses(home[None])[0]
    # of a narrow gap half is kept, and a quarter is left to searches as room
    wanted = np.minimum(margin, 0.5 * at_home) + np.minimum(BOX_ROOM, 0.25 * at_home)
    signs = rng.uniform(-1.0, 1.0, (BOX_POSES, len(home)))
    signs = np.sign(signs) * np.abs(signs) ** (1.0 / 3.0)  # corners are where a box is not clear

    def ends(part: Array) -> tuple[Array, Array]:
        return np.maximum(home - part * half, low), np.minimum(home + part * half, high)

    def clear(part: Array) -> bool:
        lower, upper = ends(part)
        poses = np.where(signs < 0.0, home + signs * (home - lower), home + signs * (upper - home))
        return float(clear_poses(gaps, poses, wanted).mean()) >= CLEAR

    part = _grown(clear, _shrunk(clear, len(home)), rng)
    return ends(part)


def clear_poses(gaps: Gaps, poses: Array, wanted: Array) -> Mask:
    """(T,) whether every gap is at least `wanted` (n,) m wide, where it can be at all."""
    return np.asarray(np.all(gaps.of_poses(poses) >= np.minimum(wanted, CUTOFF), axis=1))


def _shrunk(clear: Callable[[Array], bool], size: int) -> Array:
    part = np.ones(size)
    while not clear(part) and part[0] > LEAST_BOX:
        part = SMALLER * part
    return part


def _grown(clear: Callable[[Array], bool], part: Array, rng: np.random.Generator) -> Array:
    for _ in range(ROUNDS):
        for j in rng.permutation(len(part)):
            trial = part.copy()
            trial[j] = min(LARGER * part[j], 1.0)
            if trial[j] > part[j] and clear(trial):
                part = trial
    return part
