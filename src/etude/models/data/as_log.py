"""Conversion of users' states to a Log: from arrays by channel, or a data frame with a column for each
part."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from etude.abilities import SupportsMemory
from etude.errors import UsageError
from etude.protocols import Inputs
from etude.types import Array, Channel, Column, Log

TIMES = ("t", "time")
"""Names of the instants (n,), s, among arrays by channel and columns of a data frame."""
BY_THEMSELVES = (
    "The states have no times, so each row was treated separately, without the memory of friction. Give "
    "t (n,) in s with them, or a Log; then the rows are one run."
)


@dataclass(frozen=True)
class Run:
    """States as inputs of a model's predictions.

    Attributes:
        log: with what friction remembers of the rows before, where they follow one another.
        notes: sentences about that.
    """

    log: Log
    notes: tuple[str, ...] = ()


@runtime_checkable
class Frame(Protocol):
    """A data frame of polars, pandas, ...: names of its columns, and one by name."""

    @property
    def columns(self) -> Any: ...
    def __getitem__(self, name: str) -> Any: ...


def as_run(states: Any, columns: Sequence[Column], inputs: Inputs) -> Run:
    """States as for `as_log`, each row with what friction remembers of those before (`SupportsMemory`).

    Rows that carry times are a run from rest, in order; without times each counts by itself, which is said
    where friction remembers. A single row of a Log is as it is: a controller carries what it remembers.
    """
    log = as_log(states, columns)
    if isinstance(states, Log) or _times(states) is not None:
        return Run(followed(inputs, log) if len(log) > 1 else log)
    alone = inputs.apart(log) if isinstance(inputs, SupportsMemory) else log
    return Run(alone, () if alone is log else (BY_THEMSELVES,))


def as_log(states: Any, columns: Sequence[Column]) -> Log:
    """The states as a Log with the channels that a model looks at.

    Args:
        states: a Log, as it is; a mapping from channel to (n, parts) arrays; or a data frame (polars, pandas)
            with columns named as in files, q_elbow for part elbow of channel q. The latter two may have
            `TIMES`.
        columns: that it looks at.

    Raises:
        UsageError: a channel is missing, or has another shape than is wanted, or holds what is not a number.
    """
    if isinstance(states, Log):
        return states
    channels = _channels(columns)
    if isinstance(states, Mapping):
        values = {name: _array(states, channel) for name, channel in channels.items()}
    elif isinstance(states, Frame):
        values = {name: _from_frame(states, channel) for name, channel in channels.items()}
    else:
        raise UsageError(
            f"states cannot be read from a {type(states).__name__}",
            next_step=f"Give a Log, a data frame, or a mapping with {', '.join(channels)}.",
        )
    rows = {name: len(array) for name, array in values.items()}
    if len(set(rows.values())) > 1:
        raise UsageError(
            f"channels have different numbers of rows: {rows}", next_step="Give each one row per instant."
        )
    count, t = max(rows.values(), default=0), _times(states)
    if t is not None and (t.shape != (count,) or not np.isfinite(t).all() or bool((np.diff(t) <= 0.0).any())):
        raise UsageError(
            f"times of shape {t.shape} do not fit {count} rows in increasing order",
            next_step="Give t (n,) in s, in increasing order, or leave it out.",
        )
    return Log(np.arange(count, dtype=float) if t is None else t, channels, values)


def _times(states: Any) -> Array | None:
    """Instants that mappings and data frames carry."""
    names = states if isinstance(states, Mapping) else states.columns if isinstance(states, Frame) else ()
    name = next((name for name in TIMES if name in names), None)
    if name is None:
        return None
    try:
        return np.asarray(states[name], dtype=float)
    except (TypeError, ValueError):
        raise UsageError(f"{name} contains values that are not numbers") from None


def followed(inputs: Inputs, log: Log) -> Log:
    """The log with what physics remembers of the rows before (`SupportsMemory`), where it remembers."""
    return inputs.followed(log) if isinstance(inputs, SupportsMemory) else log


def carried(inputs: Inputs, row: Log, before: Array | None) -> tuple[Log, Array | None]:
    """The same of one row, with what the row before left; and what this one leaves."""
    return inputs.carried(row, before) if isinstance(inputs, SupportsMemory) else (row, None)


def _channels(columns: Sequence[Column]) -> dict[str, Channel]:
    parts: dict[str, dict[str, str]] = {}
    for channel, part, unit, op in columns:
        part_units = parts.setdefault(channel, {})
        part_units.setdefault(part, unit if not op else "")
    return {
        name: Channel(name, tuple(units), tuple(units.values()), derivative_of=_base(name, parts))
        for name, units in parts.items()
    }


def _base(name: str, parts: Mapping[str, Mapping[str, str]]) -> str:
    """The channel whose rate that is by the field's names, q of qd and qd of qdd; "" of none."""
    base = name.removesuffix("d")
    return base if base != name and base in parts and list(parts[base]) == list(parts[name]) else ""


def _array(states: Mapping[str, Any], channel: Channel) -> Array:
    if channel.name not in states:
        raise UsageError(
            f"there is no {channel.name!r} among the states, only {', '.join(map(str, states)) or 'nothing'}",
            next_step=f"Give {channel.name} with shape {_shape(channel)}.",
        )
    try:
        array = np.asarray(states[channel.name], dtype=float)
    except (TypeError, ValueError):
        raise UsageError(f"{channel.name} contains values that are not numbers") from None
    if array.ndim != 2 or array.shape[1] != len(channel.parts):
        raise UsageError(
            f"{channel.name} has shape {array.shape}, expected {_shape(channel)}",
            next_step="One row per instant, one column per part, in this order.",
        )
    return array


def _shape(channel: Channel) -> str:
    return f"(n, {len(channel.parts)}): {', '.join(channel.parts)}"


def _from_frame(frame: Any, channel: Channel) -> Array:
    names = [f"{channel.name}_{part}" for part in channel.parts]
    missing = [name for name in names if name not in frame.columns]
    if missing:
        raise UsageError(
            f"the data frame has no column {', '.join(missing)}",
            next_step=f"It needs {', '.join(names)} for {channel.name}.",
        )
    return np.column_stack([np.asarray(frame[name].to_numpy(), dtype=float) for name in names])
