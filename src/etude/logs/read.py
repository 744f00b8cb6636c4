"""From a file to a cleaned RobotLog: columns matched, units checked, rows repaired, motion identified."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError
from etude.logs.columns import Matching, match_columns, normal, split_unit
from etude.logs.doctor import (
    add_repair,
    check_constant,
    drop_spikes,
    drop_unreadable,
    note_pauses,
    order_rows,
)
from etude.logs.identity import align_with
from etude.logs.log import RobotLog
from etude.logs.parquet import is_cleaned, read_parquet
from etude.logs.table import Table, read_table
from etude.logs.units import (
    TIME_UNITS,
    check_commands,
    check_consistency,
    check_positions,
    start_at_zero,
    time_factor,
)
from etude.robots.spec import RobotSpec
from etude.trajectories.samples import Trajectory

Array = NDArray[np.float64]

TIME_WORDS = ("t", "time", "timestamp", "stamp", "time_stamp", "seconds", "timestamps")
STAMP_WORDS = {"sec": ("header_stamp_sec", "stamp_sec", "sec"), "nanosec": ("nanosec", "stamp_nanosec")}
LEAST_ROWS = 50
ANGLE_CHANNELS = ("q", "qd", "qdd", "q_des", "qd_des", "qdd_des", "q_true")


def read_log(
    path: str | Path, spec: RobotSpec, *, trajectory: Trajectory | None = None, degrees: bool = False
) -> RobotLog:
    """Reads, checks and repairs a recorded motion of the robot `spec`.

    Args:
        path: CSV or Parquet (`logs.table.READERS`); headers as `logs.columns` describes.
        spec: whose joints, units and limits the log must fit.
        trajectory: the proposal that was run, if there was one; the log must be of it.
        degrees: the file's angles are degrees; convert them.

    Raises:
        DataError: the file cannot be used; the message says what, where and what to do.
    """
    path = Path(path)
    if path.suffix.lower() == ".parquet" and is_cleaned(path):
        log = _same_axes(read_parquet(path), spec)
    else:
        table = read_table(path)
        log = _assemble(table, match_columns(_signal_headers(table), spec, path.name), spec, path)
    if degrees:
        log = _from_degrees(log)
    return clean_log(log, spec, trajectory=trajectory)


def clean_log(log: RobotLog, spec: RobotSpec, *, trajectory: Trajectory | None = None) -> RobotLog:
    """The doctor's round over a log whose columns are in place; `read_log` ends with it. Errors as there."""
    log = order_rows(drop_unreadable(log))
    if len(log.t) < LEAST_ROWS:
        raise DataError(
            f"only {len(log.t)} usable rows; a log needs at least {LEAST_ROWS}",
            where=log.source,
            next_step="Was the recording cut? Export it again.",
        )
    log = note_pauses(start_at_zero(log))
    check_consistency(log, spec)
    # A wild cell must not decide the unit, and a wrong unit must not look like wild cells.
    if _looks_scaled(log, spec):
        log = drop_spikes(check_positions(log, spec), spec)
    else:
        log = check_positions(drop_spikes(log, spec), spec)
    log = check_constant(check_commands(log, spec))
    return log if trajectory is None else align_with(log, trajectory, spec)


def _looks_scaled(log: RobotLog, spec: RobotSpec) -> bool:
    """Whether positions are mostly outside the limits, or move mostly faster than the robot can."""
    outside = (log.q < spec.lower) | (log.q > spec.upper)
    fast = np.abs(np.diff(log.q, axis=0)) > 2 * spec.velocity * np.diff(log.t)[:, None]
    return bool(max(outside.mean(axis=0).max(), fast.mean(axis=0).max()) > 0.1)


def _same_axes(log: RobotLog, spec: RobotSpec) -> RobotLog:
    if set(log.names) != set(spec.names):
        raise DataError(
            f"the log has the joints {', '.join(log.names)}, the robot {', '.join(spec.names)}",
            where=log.source,
            next_step="Tell a log of this robot.",
        )
    return log


def _signal_headers(table: Table) -> list[str]:
    return [name for name in table.columns if not _is_time(name)]


def _is_time(header: str) -> bool:
    text = normal(split_unit(header)[0])
    stamps = [word for words in STAMP_WORDS.values() for word in words]
    return _time_word(text) in TIME_WORDS or text in stamps or text.endswith("stamp_nanosec")


def _time_word(text: str) -> str:
    for unit in TIME_UNITS:
        if text.endswith(f"_{unit}"):
            return text.removesuffix(f"_{unit}")
    return text


def _assemble(table: Table, matching: Matching, spec: RobotSpec, path: Path) -> RobotLog:
    t, time_repairs = read_time(table, spec.rate, path.name)
    repairs = [*table.repairs, *time_repairs, *matching.repairs]
    channels = {}
    for channel, columns in matching.channels.items():
        factors = np.array([column.factor for column in columns])
        channels[channel] = np.column_stack([table.columns[column.name] for column in columns]) * factors
        if np.any(factors != 1.0):
            repairs.append(f"Channel {channel} was converted from the unit in its headers.")
    return RobotLog(
        names=spec.names,
        command_unit=spec.command_unit,
        t=t,
        q=channels.pop("q"),
        tau=channels.pop("tau"),
        **channels,
        source=path.name,
        repairs=tuple(repairs),
    )


def read_time(table: Table, rate: float, where: str) -> tuple[Array, list[str]]:
    """Time (T,) in s, from whichever columns hold it, and a sentence for each thing that was done.

    Raises:
        DataError: there is no time column, it has no numbers, or its steps fit no unit at `rate` Hz.
    """
    headers = [name for name in table.columns if _is_time(name)]
    by_word = {normal(split_unit(name)[0]): name for name in headers}
    sec = next((by_word[w] for w in STAMP_WORDS["sec"] if w in by_word), None)
    nanosec = next((name for word, name in by_word.items() if word.endswith("nanosec")), None)
    if sec is not None and nanosec is not None:
        seconds, nanos = table.columns[sec], table.columns[nanosec]
        # Whole seconds since 1970 and nanoseconds together exceed a double's digits: subtract first.
        return seconds - np.nanmin(seconds) + 1e-9 * nanos, [f"Time is {sec} and {nanosec} together."]
    plain = [name for name in headers if _time_word(normal(split_unit(name)[0])) in TIME_WORDS]
    if not plain:
        raise DataError(
            "there is no time column",
            where=where,
            next_step=f"Name it one of {', '.join(TIME_WORDS)}; the file has {', '.join(table.columns)}.",
        )
    first, repairs = plain[0], []
    if len(plain) > 1:
        repairs.append(f"Of the time columns {', '.join(plain)} the first was used.")
    values = table.columns[first]
    finite = values[np.isfinite(values)]
    if len(finite) < 2:
        raise DataError(
            "the time column has no numbers",
            where=f"{where}, column {first}",
            next_step="Write time as a number of seconds.",
        )
    bare, unit = split_unit(first)
    stated = unit or next((u for u in TIME_UNITS if normal(bare).endswith(f"_{u}")), "")
    factor, name = (TIME_UNITS[stated], stated) if stated in TIME_UNITS else time_factor(finite, rate, where)
    if name != "s":
        repairs.append(f"Time was converted from {name} (column {first}).")
    if factor == 1.0:
        return values, repairs
    # Nanoseconds since 1970 lose digits when scaled: subtract the start first.
    start = finite[0] if abs(finite[0]) * factor > 1e6 else 0.0
    return (values - start) * factor, repairs


def _from_degrees(log: RobotLog) -> RobotLog:
    converted = {c: np.deg2rad(getattr(log, c)) for c in ANGLE_CHANNELS if getattr(log, c) is not None}
    return add_repair(replace(log, **converted), "Angles were converted from degrees, as asked.")
