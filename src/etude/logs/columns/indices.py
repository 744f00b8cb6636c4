"""The index of a table, which libraries write without a name, as its time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from etude.logs.columns.vocabulary import INDEX, is_time, normal
from etude.types import Array, Log


def with_index(raw: Log) -> Log:
    """The log with its index as a column of time, where there is no other; row numbers are none.

    Where a reader knows the times, or a header says time, it stays as it is.
    """
    if any(map(is_time, raw.values)) or not np.array_equal(raw.t, np.arange(len(raw))):
        return raw
    for name, values in raw.values.items():
        if INDEX.fullmatch(normal(name)) and _advances(values[:, 0]):
            channel = replace(raw.channels[name], name="time")
            kept = raw.without(name)
            said = f"There is no time column; the index ({name}) was taken for it."
            return kept.put(channel, values).repaired(said)
    return raw


def _advances(values: Array) -> bool:
    """Whether values (T,) grow from row to row, and are not row numbers."""
    steps = np.diff(values[np.isfinite(values)])
    return bool(len(steps) and (steps > 0.0).mean() > 0.5 and not (steps == 1.0).all())
