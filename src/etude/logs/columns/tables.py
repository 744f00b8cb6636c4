"""Tables as they come: rows of several topics at once, silent topics, and an index without a name.

PlotJuggler exports each row as a message of one topic, so most cells are empty. The columns that are filled
at the same rows belong together, as topics of a bag do.
"""

from __future__ import annotations

import itertools
from collections import Counter
from dataclasses import replace

import numpy as np

from etude.logs.cleaning.smoothing import segments
from etude.logs.columns.vocabulary import INDEX, is_time, normal
from etude.types import Array, Log, Mask

WHOLE = 0.95
"""Part of the rows: columns that are filled in so many are a table with a few empty cells."""
SHARED = 0.5
"""Part of the leader's rows in which all columns are filled: with more, empty cells are damage."""


def without_holes(raw: Log) -> Log:
    """The rows of the columns that are filled most often, the others interpolated; or the log as it is."""
    t = next((raw[name][:, 0] for name in raw.values if is_time(name)), None)
    if t is None and not np.array_equal(raw.t, np.arange(len(raw))):
        t = raw.t  # of messages, of which each names other joints
    if t is None or len(t) < 2 or not np.isfinite(t).all():
        return raw
    filled: dict[bytes, Mask] = {}
    count: Counter[bytes] = Counter()
    every, whole, holed = np.ones(len(raw), dtype=bool), 0, 0
    for name, values in raw.values.items():
        finite = np.isfinite(values[:, 0])
        whole += bool(finite.all()) and not is_time(name)
        holed += not finite.all()
        if finite.sum() > 1:
            filled[np.packbits(finite).tobytes()] = finite
            count[np.packbits(finite).tobytes()] += 1
            every &= finite
    partial = [finite for finite in filled.values() if not finite.all()]
    if len(partial) < 2 or max(finite.sum() for finite in partial) > WHOLE * len(raw):
        return raw
    leader = max(partial, key=lambda finite: (int(finite.sum()), count[np.packbits(finite).tobytes()]))
    if every.sum() > SHARED * leader.sum() or whole >= holed:  # a table of rows
        return raw
    said = ["Columns that are filled at different rows were joined by time."]
    joined = {name: _at(name, t, own[:, 0], leader, said)[:, None] for name, own in raw.values.items()}
    return replace(raw, t=raw.t[leader], values=joined).repaired(*said)


def _at(name: str, t: Array, signal: Array, rows: Mask, said: list[str]) -> Array:
    filled = np.isfinite(signal)
    if filled[rows].all() or filled.sum() < 2:
        return np.asarray(signal[rows])
    order = np.argsort(t[filled], kind="stable")
    own, values = t[filled][order], signal[filled][order]
    silent, sentences = silences(f"Column {name}", t[rows], own)
    said += sentences
    return np.where(silent, np.nan, np.interp(t[rows], own, values, left=np.nan, right=np.nan))


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
