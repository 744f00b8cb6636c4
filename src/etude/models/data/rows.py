"""Which samples a model learns from: each once, in order, spread over all trajectories, far enough apart."""

from __future__ import annotations

import numpy as np

from etude.types import Array, Index, Mask, Samples

HEARD = ("state", "command", "plan")
"""Roles of the channels that tell samples apart."""


def in_order(samples: Samples) -> Samples:
    """Sorted by trajectory and time, every sample once: order and repetition of telling change nothing.

    A sample is told twice if its time, states, plans, commands and masks are the same; that of the first
    trajectory stays.
    """
    log = samples.log
    heard = [log.values[n] for n, channel in log.channels.items() if channel.role in HEARD]
    rows = np.column_stack([log.t, *heard, samples.usable, samples.moving]).astype(float) + 0.0  # no -0
    place: dict[bytes, int] = {}
    for i in np.argsort(samples.group, kind="stable").tolist():
        place.setdefault(rows[i].tobytes(), i)
    kept = np.fromiter(place.values(), dtype=np.int64, count=len(place))
    return samples.take(kept[np.lexsort((samples.t[kept], samples.group[kept]))])


def spread_points(
    t: Array, group: Index, use: Mask, count: int, spacing: float, rng: np.random.Generator
) -> Index:
    """At most `count` positions (m,) of samples with `use`, increasing, evenly spread with a random offset.

    Within a trajectory two of them are at least `spacing` seconds apart. A fixed stride over smooth motion
    decorrelates the points; its random offset avoids resonance with the motion's period.
    """
    candidates = np.flatnonzero(use)
    if spacing > 0:
        candidates = candidates[apart(t[candidates], group[candidates], spacing)]
    if len(candidates) <= count:
        return candidates
    places = (np.arange(count) + rng.uniform()) * (len(candidates) / count)
    return np.asarray(candidates[places.astype(np.int64)])


def seconds_of(samples: Samples) -> float:
    """How long all trajectories last together, pauses included."""
    return float(sum(np.ptp(samples.t[samples.group == number]) for number in np.unique(samples.group)))


def apart(t: Array, group: Index, spacing: float) -> Index:
    """Positions that keep each trajectory's samples `spacing` apart, greedily from its first one."""
    kept, last_t, last_group = [], -np.inf, None
    for i, (time, number) in enumerate(zip(t.tolist(), group.tolist(), strict=True)):
        if number != last_group or time - last_t >= spacing * (1 - 1e-9):
            kept.append(i)
            last_t, last_group = time, number
    return np.array(kept, dtype=np.int64)
