"""Topics that fall silent while others go on: what they would have said in between is nobody's to say."""

from __future__ import annotations

import itertools

import numpy as np

from etude.logs.cleaning.smoothing import segments
from etude.types import Array, Mask

SHORTEST_S = 0.2
"""Over which a line between two messages is taken for what was measured."""
MOSTLY = 0.1
"""Part of the log: a topic that is silent for longer speaks when there is something to say, and holds."""


def silences(topic: str, times: Array, t: Array) -> tuple[Mask, tuple[str, ...]]:
    """At which of `times` nothing is known of a topic, and what is to be said of it.

    A topic that is silent for long is left to interpolation: a command that is sent only while something is
    asked for is no sensor that was cut off.

    Args:
        topic: its name.
        times: (T,) s at which it is to be known.
        t: (n,) s of its messages.
    """
    found = _between(times, np.sort(t[np.isfinite(t)]))
    if not found.any():
        return found, ()
    seconds = float(found.sum() * np.median(np.diff(times)))
    fact = f"{topic} is silent for {seconds:.3g} s while others go on"
    if found.mean() > MOSTLY:
        return np.zeros_like(found), (f"{fact}: its values in between were interpolated.",)
    return found, (f"{fact}: what it would have said there was left out.",)


def _between(times: Array, t: Array) -> Mask:
    found = np.zeros(len(times), dtype=np.bool_)
    for before, after in itertools.pairwise(segments(t)):
        start, end = t[before.stop - 1], t[after.start]
        if end - start > SHORTEST_S:
            found |= (times > start) & (times < end)
    return found
