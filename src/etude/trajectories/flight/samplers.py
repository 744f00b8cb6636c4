"""Random flights: uniform on the feasible set, of scaled random direction, and on its edge."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from etude.trajectories.extremes import ROOM
from etude.trajectories.flight.feasible_set import FeasibleSet

Array = NDArray[np.float64]

STEPS = 200
"""Steps of hit-and-run from the centre."""


def uniform_parameters(
    rng: np.random.Generator, feasible: FeasibleSet, count: int = 1, steps: int = STEPS
) -> Array:
    """(count, P) parameters, uniform on the set: the end of a hit-and-run walk each, independent.

    Each step draws a direction, meets the exact ends of the line through the set, and moves to a uniform
    point between them (Smith 1984). Directions are drawn in units of the set's widths, which changes how
    fast the walk mixes and not where to.
    """
    points, widths = np.tile(feasible.centre, (count, 1)), feasible.widths()
    for _ in range(steps):
        directions = rng.standard_normal(points.shape) * widths
        low, high = feasible.chord(points, directions)
        points = points + (ROOM * rng.uniform(low, high))[:, None] * directions
    return points


def scaled_parameters(rng: np.random.Generator, feasible: FeasibleSet, count: int = 1) -> Array:
    """(count, P) parameters at U(0.2, 1) of the way from the centre to the edge, in random directions.

    Directions are drawn in units of the set's widths. Timid: the first limit that is touched bounds all axes.
    """
    return _along_rays(rng, feasible, rng.uniform(0.2, 1.0, count))


def boundary_parameters(rng: np.random.Generator, feasible: FeasibleSet, count: int = 1) -> Array:
    """(count, P) parameters on the edge of the set, in the random directions of `scaled_parameters`."""
    return _along_rays(rng, feasible, np.ones(count))


def _along_rays(rng: np.random.Generator, feasible: FeasibleSet, shares: Array) -> Array:
    directions = rng.standard_normal((len(shares), feasible.size)) * feasible.widths()
    _, high = feasible.chord(np.tile(feasible.centre, (len(shares), 1)), directions)
    return np.asarray(feasible.centre + (ROOM * shares * high)[:, None] * directions)


SAMPLERS = {
    "uniform": uniform_parameters,
    "scaled": scaled_parameters,
    "boundary": boundary_parameters,
}
"""The three random baselines, by name."""
