"""Where the filter smears what friction does: at a joint that turns round fast.

A joint that sticks before it turns is masked for long enough. One that is led through its reversal, by a
feedforward or by a good controller, is slow for some hundredths of a second, and the step of its friction is
spread by the filter over samples whose speed looks innocent: the exact model is wrong there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from etude.types import Array, Mask, Samples


def near_reversals(speed: Array, slow: Mask, reach: int, longest: int) -> Mask:
    """(T, J) rows from which a fast reversal is less than `reach` rows away.

    Args:
        speed: (T, J) of each joint, on a uniform grid.
        slow: (T, J) where it counts as standing.
        reach: rows on either side; of a zero-phase filter of second order, the answer to a step has fallen
            to a hundredth after one period of the cutoff.
        longest: rows that a joint may be slow between two ways for its reversal to be fast.
    """
    near = np.zeros(speed.shape, dtype=bool)
    for j in range(speed.shape[1]):
        moving = np.flatnonzero(~slow[:, j])
        way = np.sign(speed[moving, j])
        fast = np.flatnonzero((way[1:] != way[:-1]) & (np.diff(moving) <= longest))
        for before, after in zip(moving[fast], moving[fast + 1], strict=True):
            near[max(0, before - reach) : after + reach + 1, j] = True
    return near


def spared(samples: Samples, plenty: int) -> Samples:
    """The same, with every sample usable again of joints that have fewer than `plenty` left.

    While samples are few, what a smeared one says of inertia is worth more than its error about friction:
    on real logs of half a minute leaving them out cost up to a half.
    """
    few = np.sum(samples.usable & samples.moving, axis=0) < plenty
    return replace(samples, usable=samples.usable | few)
