"""Reading of a file into a cleaned Log: columns matched, units checked, rows repaired, for any channels.

Times begin at 0 unless the log itself marks its 0; `alignment.align` moves 0 to the start of the trajectory.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from etude.errors import DataError
from etude.logs.cleaning.ranges import check_commands, check_consistency, check_positions, looks_scaled
from etude.logs.cleaning.repairs import (
    check_constant,
    check_leaps,
    drop_spikes,
    drop_unreadable,
    note_pauses,
    order_rows,
)
from etude.logs.columns.families import answer
from etude.logs.columns.headers import Column
from etude.logs.columns.mapping import mapped
from etude.logs.columns.matching import Matching, match_columns
from etude.logs.columns.units import Limits, Stated, check_lengths, from_degrees, read_time, start_at_zero
from etude.logs.columns.vocabulary import is_time
from etude.logs.config import LogConfig
from etude.logs.readers.log_file import is_log_file, read_log_file
from etude.logs.readers.registry import cut_sentences, file_head, read_raw, with_rest_reported
from etude.types import Array, Channel, Log

LEAST_ROWS = 50  # fewer rows are not informative
Settle = Callable[[Log], Log]


def read_log(
    path: str | Path,
    channels: Sequence[Channel],
    *,
    rate: float,
    degrees: bool = False,
    limits: Limits | None = None,
    topics: Sequence[str] = (),
    config: LogConfig | None = None,
    own_clock: bool = False,
    settle: Settle | None = None,
) -> Log:
    """Reads, checks and repairs a recorded motion.

    Args:
        path: CSV, Parquet, or a format of another package's reader; headers as in `logs.columns`.
        channels: of the robot: those that a log may have, and must have (`Channel.required`).
        rate: usual rate of such logs, Hz; it identifies the unit of the times.
        degrees: the file's angles and their rates are degrees; convert them all.
        limits: lower and upper (parts,) by channel. Those of positions identify another unit; those of rates,
            wild cells; those of commands, another unit and saturation.
        topics: of a file that holds several.
        config: other names of columns, and topics if none are given.
        own_clock: keep the recorded times, which `alignment.align` uses for a periodic motion; an unsolicited
            log then needs `units.start_at_zero`.
        settle: function that decides on the log before ranges are checked; see `clean_log`.

    Raises:
        DataError: the file cannot be used; the message says what, where and what to do.
    """
    path = Path(path)
    with np.errstate(all="ignore"):  # wild numbers are checked below, without NumPy's warnings
        log, stated = matched_log(path, channels, rate, topics, config)
        if degrees:
            log = from_degrees(log, stated)
        log = clean_log(log, channels, limits, stated, settle)
        return log if own_clock else start_at_zero(log)


def matched_log(
    path: Path,
    channels: Sequence[Channel],
    rate: float,
    topics: Sequence[str] = (),
    config: LogConfig | None = None,
) -> tuple[Log, Stated]:
    """The log in a file with matched columns in SI, by the stated units, its rows as recorded; and the
    stated units. Arguments and errors as of `read_log`.
    """
    if _is_stored(path):
        return _stored(path, channels)
    return _recorded(path, channels, rate, topics, config or LogConfig())


def clean_log(
    log: Log,
    channels: Sequence[Channel],
    limits: Limits | None = None,
    stated: Stated | None = None,
    settle: Settle | None = None,
) -> Log:
    """The repairs and checks of a log with matched columns; the last step of `read_log`. Errors as there.

    Args:
        stated: units that the file states; those of positions are not questioned.
        settle: from the log with ordered rows to one with right clock and rates, or a refusal. None: rates in
            another unit than their positions are refused.
    """
    limits, stated = limits or {}, stated or {}
    log = drop_spikes(order_rows(drop_unreadable(log)))
    if len(log) < LEAST_ROWS:
        raise DataError(
            f"only {len(log)} usable rows; a log needs at least {LEAST_ROWS}. {ending(log)}".rstrip(" ."),
            where=log.source,
            next_step="If the recording was truncated, export it again.",
        )
    log = note_pauses(log)
    log = _consistent(log) if settle is None else settle(log)
    # A leap must not decide the unit, and a wrong unit must not count as leaps.
    if looks_scaled(log, channels, limits):
        log = check_leaps(check_positions(log, limits), channels, limits)
    else:
        log = check_positions(check_leaps(log, channels, limits), limits)
    return check_lengths(check_constant(check_commands(log, limits, stated)), stated)


def _consistent(log: Log) -> Log:
    check_consistency(log)
    return log


def ending(log: Log) -> str:
    """The sentence on why and where a run was cut, or ""."""
    return " ".join(cut_sentences(log))


def _is_stored(path: Path) -> bool:
    return path.suffix.lower() == ".parquet" and bool(file_head(path)) and is_log_file(path)


def _stored(path: Path, channels: Sequence[Channel]) -> tuple[Log, Stated]:
    """A log written by Étude, with the robot's channels; all of them have a known unit."""
    log = read_log_file(path)
    values = {}
    for channel in channels:
        if channel.name in log:
            values[channel.name] = _in_order(log, channel)
        elif channel.required:
            raise DataError(f"the log has no channel {channel.name}", where=log.source, next_step=OTHER)
    present = {c.name: c for c in channels if c.name in values}
    return replace(log, channels=present, values=values), {c.name: c.units for c in present.values()}


OTHER = "Ingest a log of this robot."


def _in_order(log: Log, channel: Channel) -> Array:
    """The values of a channel in the order of the robot's parts."""
    parts = log.channels[channel.name].parts
    if set(parts) != set(channel.parts):
        raise DataError(
            f"the log has {', '.join(parts)} in its channel {channel.name}, but the robot has "
            f"{', '.join(channel.parts)}",
            where=log.source,
            next_step=OTHER,
        )
    order = [parts.index(part) for part in channel.parts]
    return log[channel.name] if order == sorted(order) else log[channel.name][:, order]


def _recorded(
    path: Path, channels: Sequence[Channel], rate: float, topics: Sequence[str], config: LogConfig
) -> tuple[Log, Stated]:
    """A log of other software with matched columns in SI, and the units in its headers."""
    plain = read_raw(path, topics or config.topics)
    raw = mapped(plain, config)
    matching = _matched(raw, channels, path.name, raw.values.keys() - plain.values.keys())
    del plain
    t, time_repairs = read_time(raw, rate, path.name)
    repairs = [*raw.repairs, *time_repairs, *matching.repairs]
    values = {}
    left = dict(raw.values)
    del raw  # memory: a long log must not be held twice
    for name, columns in matching.channels.items():
        values[name] = _take_channel(left, columns)
        repairs += _conversion(name, columns)
    log = Log(
        t=t,
        channels={c.name: c for c in channels if c.name in values},
        values=values,
        source=path.name,
        repairs=tuple(repairs),
    )
    stated = {
        name: tuple(column.written_unit for column in columns)
        for name, columns in matching.channels.items()
        if any(column.stated for column in columns)
    }
    return with_rest_reported(log), stated


def _conversion(name: str, columns: Sequence[Column]) -> list[str]:
    """A sentence if units of a channel's columns were converted; it names the columns if not all were."""
    converted = [column for column in columns if column.factor != 1.0]
    if not converted:
        return []
    units = ", ".join(dict.fromkeys(column.written_unit for column in converted))
    some = "" if len(converted) == len(columns) else f" ({', '.join(c.name for c in converted)})"
    return [f"Channel {name}{some} was converted from {units}, as stated."]


def _matched(raw: Log, channels: Sequence[Channel], where: str, told: Collection[str]) -> Matching:
    """The columns of each channel. DataError: some are missing, with the reader's notes, which may explain
    it; or several families may be the commands.
    """
    try:
        matching = match_columns([name for name in raw.values if not is_time(name)], channels, where, told)
        _check_families(matching, raw, channels, where)
        return matching
    except DataError as error:
        read = f" The reader's notes: {' '.join(raw.repairs)}" if raw.repairs else ""
        raise DataError(error.fact, where=error.where, next_step=error.next_step + read) from None


SAME = 1e-6  # part of the deviation: columns that differ by less are copies


def _check_families(matching: Matching, raw: Log, channels: Sequence[Channel], where: str) -> None:
    """Raises a DataError if several families of columns may be the commands; constant ones and copies do not
    count.
    """
    values = {
        name: np.hstack([raw[column] for column in columns]) for name, columns in matching.families.items()
    }
    first = next(iter(values), "")
    others = {name for name, columns in values.items() if name != first and _differs(columns, values[first])}
    if not others:
        return
    families = {
        name: columns for name, columns in matching.families.items() if name == first or name in others
    }
    channel = next(c for c in channels if c.role == "command" and c.acts_on)
    raise DataError(
        f"{', '.join(f'{columns[0]} and the like' for columns in families.values())} may all be the commands",
        where=where,
        next_step=answer(channel, families),
    )


def _differs(values: Array, first: Array) -> bool:
    """Whether columns (T, k) vary, and differ from the first ones."""
    finite, other = (
        part[np.isfinite(values).all(axis=1) & np.isfinite(first).all(axis=1)] for part in (values, first)
    )
    if not len(finite) or not finite.std(axis=0).any():
        return False
    return bool(np.abs(finite - other).max() > SAME * other.std(axis=0).max())


def _take_channel(left: dict[str, Array], columns: Sequence[Column]) -> Array:
    """The values of a channel in SI; its columns are removed from `left`, since no other channel uses
    them.
    """
    series = [left.pop(column.name)[:, 0] for column in columns]
    out = np.empty((len(series[0]), len(series)))
    for j, column in enumerate(columns):
        np.multiply(series[j], column.factor, out=out[:, j])
        series[j] = out[:, j]
    return out
