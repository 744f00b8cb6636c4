"""Tables of several topics at once: joined where most columns have holes, left alone where few do."""

from __future__ import annotations

import numpy as np

from etude.logs.readers.registry import without_holes
from etude.types import Array, Channel, Log

T = np.arange(0.0, 2.0, 0.01)
FIRST = np.arange(len(T)) % 2 == 0


def log_of(**columns: Array) -> Log:
    values = {"time": T, **columns}
    channels = {name: Channel(name, ("",), ("",), "aside") for name in values}
    return Log(np.arange(len(T), dtype=float), channels, {n: v[:, None] for n, v in values.items()})


def half(signal: Array, told: Array) -> Array:
    return np.where(told, signal, np.nan)


def test_topics_are_joined_at_the_rows_of_one() -> None:
    q, tau = np.sin(T), np.cos(T)
    found = without_holes(log_of(q=half(q, FIRST), tau=half(tau, ~FIRST)))
    assert len(found) == len(T) // 2
    inner = slice(1, -1)
    error = found["tau"][inner, 0] - np.cos(found["time"][inner, 0])
    assert np.abs(error).max() < 1e-3


def test_an_index_beside_them_changes_nothing() -> None:
    columns = {"q": half(np.sin(T), FIRST), "tau": half(np.cos(T), ~FIRST)}
    assert len(without_holes(log_of(**columns, index=T * 100.0))) == len(T) // 2


def test_whole_columns_keep_their_rows_whatever_optional_ones_lack() -> None:
    columns = {"volts": half(np.sin(T), FIRST), "amps": half(np.cos(T), ~FIRST)}
    whole = log_of(q=np.sin(T), tau=np.cos(T), **columns)
    assert without_holes(whole) is whole
