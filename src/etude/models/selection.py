"""Which samples a model learns from: moving, distinct, spread over all trajectories, far enough apart."""

from __future__ import annotations

from dataclasses import fields
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from etude.models.dataset import Dataset

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Timed(Protocol):
    """Samples of several trajectories or flights: times (n,) and numbers (n,)."""

    @property
    def t(self) -> Array: ...

    @property
    def group(self) -> Index: ...


def in_order(dataset: Dataset) -> Dataset:
    """Sorted by trajectory and time, every sample once: order and repetition of telling change nothing."""
    rows = np.column_stack(
        [getattr(dataset, field.name) for field in fields(dataset) if field.name != "group"]
    )
    _, first = np.unique(rows[np.lexsort((dataset.group,))], axis=0, return_index=True)
    kept = dataset.take(np.lexsort((dataset.group,))[np.sort(first)])
    return kept.take(np.lexsort((kept.t, kept.group)))


def spread_points(
    dataset: Timed, use: NDArray[np.bool_], count: int, spacing: float, rng: np.random.Generator
) -> Index:
    """At most `count` positions (m,) of samples with `use`, increasing, evenly spread with a random offset.

    Within a trajectory two of them are at least `spacing` seconds apart. A fixed stride over smooth motion
    decorrelates the points; its random offset avoids resonance with the motion's period.
    """
    candidates = np.flatnonzero(use)
    if spacing > 0:
        candidates = candidates[_apart(dataset.t[candidates], dataset.group[candidates], spacing)]
    if len(candidates) <= count:
        return candidates
    places = (np.arange(count) + rng.uniform()) * (len(candidates) / count)
    return np.asarray(candidates[places.astype(np.int64)])


def _apart(t: Array, group: Index, spacing: float) -> Index:
    """Positions that keep each trajectory's samples `spacing` apart, greedily from its first one."""
    kept, last_t, last_group = [], -np.inf, None
    for i, (time, number) in enumerate(zip(t.tolist(), group.tolist(), strict=True)):
        if number != last_group or time - last_t >= spacing * (1 - 1e-9):
            kept.append(i)
            last_t, last_group = time, number
    return np.array(kept, dtype=np.int64)
