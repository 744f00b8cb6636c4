"""Tables of several topics at once: each row is a message of one of them, so most cells are empty.

PlotJuggler exports so. The columns that are told at the same rows belong together, as topics of a bag do.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from etude.logs.columns.vocabulary import is_time
from etude.logs.readers.silence import silences
from etude.types import Array, Log, Mask

WHOLE = 0.95
"""Part of the rows: columns that are told in so many are a table with a few empty cells."""
SHARED = 0.5
"""Part of the leader's rows in which all columns are told: with more, empty cells are damage."""


def without_holes(raw: Log) -> Log:
    """The rows of the columns that are told most often, the others interpolated; or the log as it is."""
    t = next((raw[name][:, 0] for name in raw.values if is_time(name)), None)
    if t is None and not np.array_equal(raw.t, np.arange(len(raw))):
        t = raw.t  # of messages, of which each names other joints
    if t is None or len(t) < 2 or not np.isfinite(t).all():
        return raw
    told: dict[bytes, Mask] = {}
    count: Counter[bytes] = Counter()
    every, whole, holed = np.ones(len(raw), dtype=bool), 0, 0
    for name, values in raw.values.items():
        finite = np.isfinite(values[:, 0])
        whole += bool(finite.all()) and not is_time(name)
        holed += not finite.all()
        if finite.sum() > 1:
            told[np.packbits(finite).tobytes()] = finite
            count[np.packbits(finite).tobytes()] += 1
            every &= finite
    partial = [finite for finite in told.values() if not finite.all()]
    if len(partial) < 2 or max(finite.sum() for finite in partial) > WHOLE * len(raw):
        return raw
    leader = max(partial, key=lambda finite: (int(finite.sum()), count[np.packbits(finite).tobytes()]))
    if every.sum() > SHARED * leader.sum() or whole >= holed:  # a table of rows
        return raw
    said = ["Columns that are told at different rows were joined by time."]
    joined = {name: _at(name, t, own[:, 0], leader, said)[:, None] for name, own in raw.values.items()}
    return replace(raw, t=raw.t[leader], values=joined).repaired(*said)


def _at(name: str, t: Array, signal: Array, rows: Mask, said: list[str]) -> Array:
    told = np.isfinite(signal)
    if told[rows].all() or told.sum() < 2:
        return np.asarray(signal[rows])
    order = np.argsort(t[told], kind="stable")
    own, values = t[told][order], signal[told][order]
    silent, sentences = silences(f"Column {name}", t[rows], own)
    said += sentences
    return np.where(silent, np.nan, np.interp(t[rows], own, values, left=np.nan, right=np.nan))
