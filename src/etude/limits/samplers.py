"""Random members of a feasible set: uniform, enlarged to the limits, of random amplitude, on the edge.

All draw (count, P) parameters inside the set; blocks are drawn independently of one another.
"""

from __future__ import annotations

import numpy as np

from etude.limits.feasible import FeasibleSet
from etude.trajectories.extremes import USABLE_PART
from etude.types import Array

STEPS = 200
"""Steps of hit-and-run from the centre."""
RECENTRED = 3
"""Number of times that a motion is centred in its room and enlarged again; joints need only one."""


def uniform(rng: np.random.Generator, feasible: FeasibleSet, count: int = 1, steps: int = STEPS) -> Array:
    """(count, P) parameters, uniform on the set: the end of a hit-and-run walk each, independent.

    Each step draws a direction, computes the exact ends of the line through each block, and moves to a
    uniform point between them (Smith 1984). Directions are drawn in units of the set's widths. This changes
    the speed of mixing, but not the limiting distribution.
    """
    points, widths = np.tile(feasible.centre, (count, 1)), feasible.widths()
    for _ in range(steps):
        directions = rng.standard_normal(points.shape) * widths
        low, high = feasible.chords(points, directions)
        points = points + (USABLE_PART * rng.uniform(low, high))[:, feasible.block_of] * directions
    return points


def scaled(rng: np.random.Generator, feasible: FeasibleSet, count: int = 1) -> Array:
    """(count, P) motions of normal amplitudes, each block enlarged to its limits wherever there is most room.

    Parameters that only shift a motion (constant terms) are then drawn uniformly from their allowed interval.
    """
    return _shifted(rng, feasible, _enlarged(rng, feasible, count))


def amplitude(rng: np.random.Generator, feasible: FeasibleSet, count: int = 1) -> Array:
    """(count, P) motions of `scaled`, each block scaled separately by U(0.1, 1), then shifted likewise."""
    points = _enlarged(rng, feasible, count)
    shares = rng.uniform(0.1, 1.0, (count, len(feasible.blocks)))[:, feasible.block_of]
    return _shifted(rng, feasible, feasible.centre + shares * (points - feasible.centre))


def timid(rng: np.random.Generator, feasible: FeasibleSet, count: int = 1) -> Array:
    """(count, P) parameters at U(0.2, 1) of the way from the centre to the edge, in random directions.

    Directions are drawn in units of the set's widths. Motions are small, since the first limit that is
    touched bounds a whole block.
    """
    return _along_rays(rng, feasible, rng.uniform(0.2, 1.0, (count, len(feasible.blocks))))


def boundary(rng: np.random.Generator, feasible: FeasibleSet, count: int = 1) -> Array:
    """(count, P) parameters on the edge of every block, in the random directions of `timid`."""
    return _along_rays(rng, feasible, np.ones((count, len(feasible.blocks))))


def _along_rays(rng: np.random.Generator, feasible: FeasibleSet, shares: Array) -> Array:
    directions = rng.standard_normal((len(shares), feasible.size)) * feasible.widths()
    _, high = feasible.chords(np.tile(feasible.centre, (len(shares), 1)), directions)
    return np.asarray(feasible.centre + (USABLE_PART * shares * high)[:, feasible.block_of] * directions)


def _enlarged(rng: np.random.Generator, feasible: FeasibleSet, count: int) -> Array:
    """Random shapes as large as the limits allow, in the middle of their room."""
    steps = rng.standard_normal((count, feasible.size))
    for block in feasible.blocks:
        steps[:, block.members[block.still]] = 0.0
    points = feasible.centre + _to_the_edge(feasible, steps)
    for _ in range(RECENTRED):
        for block in feasible.blocks:
            for i in block.still:
                low, high = _room_to_shift(feasible, points, int(block.members[i]))
                points[:, block.members[i]] += 0.5 * (low + high)
        points = feasible.centre + _to_the_edge(feasible, points - feasible.centre)
    return points


def _to_the_edge(feasible: FeasibleSet, steps: Array) -> Array:
    """The steps (K, P) from the centre, each block as long as it can be."""
    _, high = feasible.chords(np.tile(feasible.centre, (len(steps), 1)), steps)
    return np.asarray(steps * (USABLE_PART * np.where(np.isfinite(high), high, 0.0))[:, feasible.block_of])


def _shifted(rng: np.random.Generator, feasible: FeasibleSet, points: Array) -> Array:
    """The points (K, P) with each parameter that only shifts drawn anew."""
    points = points.copy()
    for block in feasible.blocks:
        for i in block.still:
            low, high = _room_to_shift(feasible, points, int(block.members[i]))
            points[:, block.members[i]] += USABLE_PART * rng.uniform(low, high)
    return points


def _room_to_shift(feasible: FeasibleSet, points: Array, place: int) -> tuple[Array, Array]:
    """Ends (K,) of the line along one parameter, from points (K, P) inside."""
    block = feasible.blocks[int(feasible.block_of[place])]
    direction = (block.members == place).astype(float)
    block_points = points[:, block.members]
    return block.chord(block_points, np.tile(direction, (len(block_points), 1)))


SAMPLERS = {
    "uniform": uniform,
    "scaled": scaled,
    "amplitude": amplitude,
    "timid": timid,
    "boundary": boundary,
}
"""By name."""
