"""How far each pair is kept apart: the margin, and less of near neighbours that pass each other narrowly.

What a pair has at home says little: a home a hand's breadth away would keep something else. Two parts with at
most two joints between them often pass each other with a few millimetres whatever the pose, by construction:
of these the distances over all clear poses count. Parts farther along the arm, and what stands around, keep
the whole margin.
"""

from __future__ import annotations

import numpy as np

from etude.types import Array, Index, Mask
from etude_arm.clearance.gaps import TOLERANCE, Gaps
from etude_arm.clearance.skeleton import BOX

NEAR = 2
"""Joints between two parts that are neighbours."""
FLOOR = 0.002
"""m, that neighbours keep at least."""
SELDOM = 0.05
"""Part of the clear poses in which neighbours are nearer than twice what they keep."""
SEED = 21
"""Of the poses that are looked at: the same robot always keeps the same."""
POSES = 1024
AT_HOME = 0.5
"""Of what a pair has at home, the part that is kept at most: home itself must stay allowed."""


def kept(gaps: Gaps, row_of: Index, home: Array, margin: float) -> Array:
    """(r,) m that each row of a certificate keeps.

    Args:
        gaps: of the robot. row_of: (n,) each gap's row.
        home: (k,) a clear pose. margin: m.
    """
    rows = int(row_of.max(initial=-1)) + 1
    at_home = _by_row(gaps.of_poses(home[None]), row_of, rows)[0]
    poses = gaps.skeleton.random_poses(np.random.default_rng(SEED), POSES)
    apart = gaps.of_poses(poses)
    clear = apart[np.all(apart > TOLERANCE, axis=1)]
    near = np.ones(rows, dtype=np.bool_)
    np.logical_and.at(near, row_of, neighbours(gaps))
    most = np.full(rows, margin)
    if len(clear):
        usual = np.quantile(_by_row(clear, row_of, rows), SELDOM, axis=0)
        most = np.where(near, np.clip(0.5 * usual, min(FLOOR, margin), margin), margin)
    return np.asarray(np.minimum(most, AT_HOME * at_home))


def neighbours(gaps: Gaps) -> Mask:
    """(n,) whether a gap is between two parts of the arm with at most `NEAR` joints between them."""
    skeleton, shapes = gaps.skeleton, gaps.skeleton.shapes
    return np.array(
        [
            gap.other >= 0
            and not shapes[gap.other].name.startswith(BOX)
            and int(skeleton.between(shapes[gap.one].part, shapes[gap.other].part).sum()) <= NEAR
            for gap in gaps.list
        ],
        dtype=np.bool_,
    )


def _by_row(distances: Array, row_of: Index, rows: int) -> Array:
    """(T, r) the least of each row, from (T, n)."""
    found = np.full((rows, len(distances)), np.inf)
    np.minimum.at(found, row_of, distances.T)
    return np.asarray(found.T)
