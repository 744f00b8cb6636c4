"""What a joint's friction remembers of the way there: Dahl's law in displacement, behind a play, compiled.

A joint at rest is held by whatever friction its last motion left. The way counts and not the time, so plan
and log remember alike at any rate that sees where the motion turns. Source: Dahl 1968.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from etude.contracts import Array


def _compile(function: Any) -> Any:
    """`njit`, cached on disk; where no folder is writable numba raises, and the cache is done without."""
    try:
        return njit(cache=True)(function)
    except RuntimeError:
        return njit(function)


def remembered(q: Array, play: Array, length: Array, start: Array | None = None) -> Array:
    """(T, 2, J) friction sigma in [-1, 1] and position p behind the play, row by row of positions q (T, J).

    sigma <- s + (sigma - s) exp(-|dp| / length), s the sign of dp, and p <- min(max(p, q - play), q + play).

    Args:
        play: (J,) half width, rad or m, that noise does not leave.
        length: (J,) way over which friction turns round, rad or m.
        start: (2, J) sigma and p before the first row; without, 0 and the first position.
    """
    out = np.empty((len(q), 2, len(play)))
    if len(q):
        first = np.stack([np.zeros(len(play)), q[0]]) if start is None else start
        _run(np.ascontiguousarray(q, dtype=float), play, length, first, out)
    return out


def pulled(q: Array, play: Array, length: Array, on_sigma: Array) -> Array:
    """Gradient (T, J) in q of sum(on_sigma * sigma), for a memory that began with the first row."""
    found = remembered(q, play, length)
    gradient = np.zeros_like(q)
    _back(found, length, np.ascontiguousarray(on_sigma), gradient)
    return gradient


@_compile
def _run(q: Array, play: Array, length: Array, first: Array, out: Array) -> None:
    for j in range(q.shape[1]):
        sigma, p = first[0, j], first[1, j]
        for i in range(len(q)):
            behind = min(max(p, q[i, j] - play[j]), q[i, j] + play[j])
            way = behind - p
            if way != 0.0:
                sign = 1.0 if way > 0.0 else -1.0
                sigma = sign + (sigma - sign) * np.exp(-abs(way) / length[j])
            p = behind
            out[i, 0, j], out[i, 1, j] = sigma, p


@_compile
def _back(found: Array, length: Array, on_sigma: Array, gradient: Array) -> None:
    for j in range(on_sigma.shape[1]):
        in_sigma, in_p = 0.0, 0.0
        for i in range(len(on_sigma) - 1, 0, -1):
            in_sigma += on_sigma[i, j]
            way = found[i, 1, j] - found[i - 1, 1, j]
            if way == 0.0:  # nothing moved behind the play
                continue
            sign = 1.0 if way > 0.0 else -1.0
            faded = np.exp(-abs(way) / length[j])
            slope = in_sigma * (sign - found[i - 1, 0, j]) * faded * sign / length[j]
            gradient[i, j] = in_p + slope  # p follows q, whatever it was before
            in_p = -slope
            in_sigma *= faded
        gradient[0, j] = in_p  # the play begins at q
