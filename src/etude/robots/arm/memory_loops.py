"""The two loops of `memory`, compiled: apart from it, so that nobody waits for the compiler who only asks."""

from __future__ import annotations

import numpy as np

from etude.compilation import compiled
from etude.contracts import Array


@compiled
def forward(q: Array, play: Array, length: Array, first: Array, out: Array) -> None:
    """Fills `out` (T, 2, J) as `memory.remembered` says, from the state `first` (2, J)."""
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


@compiled
def backward(found: Array, length: Array, on_sigma: Array, gradient: Array) -> None:
    """Fills `gradient` (T, J) as `memory.pulled` says; `found` (T, 2, J) is what `forward` left."""
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
