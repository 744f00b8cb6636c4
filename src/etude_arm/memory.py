"""Memory of a joint's friction: Dahl's law in displacement, behind a play.

The friction of its last motion holds a joint at rest. The law depends on the distance and not on time, so
plan and log give the same state at any rate that resolves the reversals. Source: Dahl 1968.
"""

from __future__ import annotations

import numpy as np

from etude._runtime.friction_memory import dahl, recursion
from etude.types import Array

MEMORY_RATE = 25.0
"""Hz at which a way must be seen: at 5 rad/s^2 a motion turns within 1 mrad between two samples, less than
most ways that friction turns round in."""


def remembered(q: Array, play: Array, length: Array, start: Array | None = None) -> Array:
    """Friction sigma in [-1, 1] and position p behind the play, (T, 2, J), along positions q (T, J).

    sigma <- s + (sigma - s) exp(-|dp| / length), s the sign of dp, and p <- min(max(p, q - play), q + play).

    Args:
        q: (T, J) rad or m.
        play: (J,) half width, rad or m, larger than noise.
        length: (J,) presliding distance, rad or m.
        start: (2, J) sigma and p before the first row; by default 0 and the first position.
    """
    if not len(q):
        return np.empty((0, 2, len(play)))
    sigma, p = np.stack([np.zeros(len(play)), q[0]]) if start is None else start
    behind = _behind(q, play, p)
    steps = np.diff(behind, axis=0, prepend=p[None])
    return np.stack([dahl(steps, length, sigma), behind], axis=1)


def turning(q: Array, play: Array, lengths: Array) -> Array:
    """Friction in [-1, 1], (T, W J), along q (T, J) for presliding distances (W, J), from rest.

    Args:
        q: (T, J) rad or m. lengths: (W, J) rad or m.
        play: (J,) as in `remembered`; at most half of a distance, so that noise is smaller than the effect.
    """
    count = len(lengths)
    plays = np.minimum(np.tile(play, count), 0.5 * lengths.ravel())
    return remembered(np.tile(q, (1, count)), plays, lengths.ravel())[:, 0]


def bristles_along(q: Array, bend: Array) -> Array:
    """Deflection (T, J) of bristles along q (T, J), initially zero; they slip at `bend` (T, J)."""
    steps = np.diff(q, axis=0, prepend=q[:1])
    faded = np.exp(-np.abs(steps) / bend)
    return recursion(faded, np.sign(steps) * bend * (1.0 - faded))


def memory_vjp(q: Array, play: Array, length: Array, on_sigma: Array) -> Array:
    """Gradient (T, J) in q of sum(on_sigma * sigma), for a memory that starts at the first row."""
    states = remembered(q, play, length)
    sigma, steps = states[:, 0], np.diff(states[:, 1], axis=0, prepend=q[:1])
    faded = np.exp(-np.abs(steps) / length)
    later = np.concatenate([faded[1:], np.ones((1, len(length)))])[::-1]
    in_sigma = recursion(later.copy(), on_sigma[::-1].copy())[::-1]
    before = np.concatenate([np.zeros((1, len(length))), sigma[:-1]])
    slopes = in_sigma * (np.sign(steps) - before) * faded * np.sign(steps) / length
    gradient = np.zeros_like(q)
    for j, slope in enumerate(slopes.T):
        at = np.flatnonzero(steps[:, j])  # elsewhere nothing moved behind the play
        gradient[at, j] = slope[at]  # p follows q, whatever it was before,
        gradient[np.append(0, at[:-1])[: len(at)], j] -= slope[at]  # and the next way begins there
    return gradient


def _behind(q: Array, play: Array, start: Array) -> Array:
    """(T, J) p <- min(max(p, low), high) from `start` (J,); two such steps are one, of other ends."""
    low, high = q - play, q + play
    step = 1
    while step < len(q):
        ends = low[step:], high[step:]
        joined = [np.minimum(np.maximum(end[:-step], ends[0]), ends[1]) for end in (low, high)]
        low[step:], high[step:] = joined
        step *= 2
    return np.minimum(np.maximum(start, low), high)
