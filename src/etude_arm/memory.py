"""Memory of a joint's friction: Dahl's law in displacement, behind a play.

A joint at rest is held by whatever friction its last motion left. The way counts and not the time, so plan
and log remember alike at any rate that sees where the motion turns. Source: Dahl 1968.

Both laws go from row to row. Steps of each kind make another of their kind when one follows another, so the
rows are joined in pairs, fours, eights: whole arrays at a time. A compiled loop would cost who only asks for
the next motion more than all else that is computed for it, as the compiler has to be loaded.
"""

from __future__ import annotations

import numpy as np

from etude.types import Array

MEMORY_RATE = 25.0
"""Hz at which a way must be seen: at 5 rad/s^2 a motion turns within 1 mrad between two samples, less than
most ways that friction turns round in."""


def remembered(q: Array, play: Array, length: Array, start: Array | None = None) -> Array:
    """(T, 2, J) friction sigma in [-1, 1] and position p behind the play, row by row of positions q (T, J).

    sigma <- s + (sigma - s) exp(-|dp| / length), s the sign of dp, and p <- min(max(p, q - play), q + play).

    Args:
        play: (J,) half width, rad or m, that noise does not leave.
        length: (J,) way over which friction turns round, rad or m.
        start: (2, J) sigma and p before the first row; without, 0 and the first position.
    """
    if not len(q):
        return np.empty((0, 2, len(play)))
    sigma, p = np.stack([np.zeros(len(play)), q[0]]) if start is None else start
    behind = _behind(q, play, p)
    ways = np.diff(behind, axis=0, prepend=p[None])
    faded = np.exp(-np.abs(ways) / length)
    own = np.sign(ways) * (1.0 - faded)
    own[0] += faded[0] * sigma
    return np.stack([_followed(faded, own), behind], axis=1)


def turning(q: Array, play: Array, lengths: Array) -> Array:
    """(T, W J) friction in [-1, 1] along q (T, J) by ways (W, J) over which it may turn round, from rest.

    Args:
        play: (J,) as for `remembered`; at most half of a way, so that noise is less than what it hides.
    """
    count = len(lengths)
    plays = np.minimum(np.tile(play, count), 0.5 * lengths.ravel())
    return remembered(np.tile(q, (1, count)), plays, lengths.ravel())[:, 0]


def bristles_along(q: Array, bend: Array) -> Array:
    """(T, J) how far bristles bend along q (T, J), straight at first; bent by `bend` (T, J) they slip."""
    ways = np.diff(q, axis=0, prepend=q[:1])
    faded = np.exp(-np.abs(ways) / bend)
    return _followed(faded, np.sign(ways) * bend * (1.0 - faded))


def pulled(q: Array, play: Array, length: Array, on_sigma: Array) -> Array:
    """Gradient (T, J) in q of sum(on_sigma * sigma), for a memory that began with the first row."""
    found = remembered(q, play, length)
    sigma, ways = found[:, 0], np.diff(found[:, 1], axis=0, prepend=q[:1])
    faded = np.exp(-np.abs(ways) / length)
    later = np.concatenate([faded[1:], np.ones((1, len(length)))])[::-1]
    in_sigma = _followed(later.copy(), on_sigma[::-1].copy())[::-1]
    before = np.concatenate([np.zeros((1, len(length))), sigma[:-1]])
    slopes = in_sigma * (np.sign(ways) - before) * faded * np.sign(ways) / length
    gradient = np.zeros_like(q)
    for j, own in enumerate(slopes.T):
        at = np.flatnonzero(ways[:, j])  # elsewhere nothing moved behind the play
        gradient[at, j] = own[at]  # p follows q, whatever it was before,
        gradient[np.append(0, at[:-1])[: len(at)], j] -= own[at]  # and the next way begins there
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


def _followed(factor: Array, own: Array) -> Array:
    """(T, J) s <- factor s + own from 0, in the memory of `own`; two such steps are one, of other factors."""
    step = 1
    while step < len(own):
        own[step:] += factor[step:] * own[:-step]
        factor[step:] *= factor[:-step].copy()
        step *= 2
    return own
