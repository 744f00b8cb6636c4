"""What a joint's friction remembers of the way there: Dahl's law in displacement, behind a play.

A joint at rest is held by whatever friction its last motion left. The way counts and not the time, so plan
and log remember alike at any rate that sees where the motion turns. Source: Dahl 1968.
"""

from __future__ import annotations

import numpy as np

from etude.contracts import Array


def remembered(q: Array, play: Array, length: Array, start: Array | None = None) -> Array:
    """(T, 2, J) friction sigma in [-1, 1] and position p behind the play, row by row of positions q (T, J).

    sigma <- s + (sigma - s) exp(-|dp| / length), s the sign of dp, and p <- min(max(p, q - play), q + play).

    Args:
        play: (J,) half width, rad or m, that noise does not leave.
        length: (J,) way over which friction turns round, rad or m.
        start: (2, J) sigma and p before the first row; without, 0 and the first position.
    """
    from etude.robots.arm.memory_loops import forward  # numba: not for those who only ask

    out = np.empty((len(q), 2, len(play)))
    if len(q):
        first = np.stack([np.zeros(len(play)), q[0]]) if start is None else start
        forward(np.ascontiguousarray(q, dtype=float), play, length, first, out)
    return out


def pulled(q: Array, play: Array, length: Array, on_sigma: Array) -> Array:
    """Gradient (T, J) in q of sum(on_sigma * sigma), for a memory that began with the first row."""
    from etude.robots.arm.memory_loops import backward

    found = remembered(q, play, length)
    gradient = np.zeros_like(q)
    backward(found, length, np.ascontiguousarray(on_sigma), gradient)
    return gradient
