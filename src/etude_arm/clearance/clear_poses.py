"""Where an arm can be: random poses that are clear of everything and seen from home in a straight line.

Nothing of it is trusted: motions that are looked for about such poses are proved one by one.
"""

from __future__ import annotations

import math

import numpy as np

from etude.types import Array, Mask, Reachable
from etude_arm.clearance.gaps import TOLERANCE
from etude_arm.clearance.limit import Clearance

POSES = 1024
"""Random ones that are tried."""
SEED = 22
"""Of these: the same robot always has the same."""
LINE = 0.2
"""rad (m): the longest step of a joint along a straight line that is looked at; clear poses leave room."""
COARSE = 5
"""Instants of a line that are looked at first: most that collide do so there."""


def one_turn(lower: Array, upper: Array, home: Array, slides: Mask) -> tuple[Array, Array]:
    """(k,) ends of the ranges, a turn about home at most: what a hinge does beyond that it has shown."""
    most = np.where(slides, upper - lower, np.minimum(upper - lower, 2.0 * math.pi))
    low = np.clip(home - 0.5 * most, lower, upper - most)
    return low, low + most


def reachable(clearance: Clearance) -> Reachable:
    """Of an arm with shapes, whose motions `clearance` limits."""
    skeleton, home = clearance.gaps.skeleton, clearance.home
    lower, upper = one_turn(skeleton.lower, skeleton.upper, home, skeleton.slides)
    tried = np.random.default_rng(SEED).uniform(lower, upper, (POSES, len(home)))
    poses = tried[_clear(clearance, tried)]
    seen = poses[_seen(clearance, home, poses)]
    return Reachable(lower, upper, np.concatenate([home[None], seen]))


def _clear(clearance: Clearance, poses: Array) -> Mask:
    """(T,) whether every gap is what searches keep."""
    return np.asarray(np.all(clearance.gaps.of_poses(poses) - TOLERANCE >= clearance.sought, axis=1))


def _seen(clearance: Clearance, home: Array, poses: Array) -> Mask:
    """(T,) whether the straight line from home to a pose is clear; lines that are not are left early."""
    seen = np.ones(len(poses), dtype=np.bool_)
    longest = np.abs(poses - home).max(axis=1)
    counts = np.maximum(COARSE, np.ceil(longest / LINE).astype(int))
    for fine in (False, True):
        own = np.flatnonzero(seen)
        steps = [np.linspace(0.0, 1.0, int(counts[i]) if fine else COARSE, endpoint=False)[1:] for i in own]
        line = np.concatenate([[0.0], *steps])[1:]
        of = np.repeat(own, [len(step) for step in steps])
        clear = _clear(clearance, home + line[:, None] * (poses[of] - home))
        seen[of[~clear]] = False
    return seen
