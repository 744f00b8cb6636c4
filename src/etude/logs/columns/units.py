"""Unit inference where a log states none: time by its steps, degrees and milli-units by limits and
consistency."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from etude.errors import DataError
from etude.logs.columns.header_units import GRAVITY
from etude.logs.columns.vocabulary import (
    MINUTES,
    STAMP_WORDS,
    TIME_SPELLINGS,
    TIME_UNITS,
    TIME_WORDS,
    is_time,
    normal,
    split_unit,
    time_word,
)
from etude.types import Array, Channel, Log

Limits = Mapping[str, tuple[Array, Array]]
Stated = Mapping[str, Sequence[str]]
"""Channel -> the unit of each part as its header spells it, "" where none; only channels with one."""

ANGLES = ("rad", "rad/s", "rad/s^2", "rad/s2", "rad/s²")
"""Units of angles and their rates: what `degrees` converts."""
LENGTH = {"specific_force": GRAVITY}
"""Channels whose length is this in the median: in flight the thrust carries the weight."""
FASTEST = {"rates": 10.0}
"""Channels whose root mean square is no larger, rad/s: more is degrees."""
TURN = {"attitude": ("roll", "pitch")}
"""Angles within a half turn."""
LIKE_TIME = {
    "time",
    "times",
    "tick",
    "ticks",
    "stamp",
    "timestamp",
    "clock",
    "sec",
    "secs",
    "seconds",
    "millis",
    "zeit",
}
"""Words of a header that may be a clock's."""
SIXTY, ALIKE = 60.0, 1.15  # a clock taken for minutes or their inverse; of rates
SLOWEST_ROWS, FASTEST_ROWS = 0.5, 1e6  # a second: no motion is seen by fewer, no recorder writes more
CLOCK_FACTOR = 50.0  # the log's rate over the usual one, or its inverse: beyond, no unit of time fits


def read_time(raw: Log, rate: float, where: str) -> tuple[Array, list[str]]:
    """Time (T,) in s from the raw columns that state it, and a sentence for each repair.

    A reader that knows the times needs no column for them.

    Raises:
        DataError: there is no time column, it has no numbers, or its steps fit no unit at `rate` Hz.
    """
    headers = [name for name in raw.values if is_time(name)]
    by_word = {normal(split_unit(name)[0]): name for name in headers}
    sec = next((by_word[w] for w in STAMP_WORDS["sec"] if w in by_word), None)
    nanosec = next((name for word, name in by_word.items() if word.endswith("nanosec")), None)
    if sec is not None and nanosec is not None and np.isfinite(raw[sec]).any():
        seconds, nanos = raw[sec][:, 0], raw[nanosec][:, 0]
        # Whole seconds since 1970 and nanoseconds together exceed a double's digits: subtract first.
        first, sentence = np.nanmin(seconds), f"Time is the sum of {sec} and {nanosec}."
        counted = [f"Time was counted from {first:.0f} s."] if first else []
        return seconds - first + 1e-9 * nanos, [sentence, *counted]
    plain = [name for name in headers if time_word(normal(split_unit(name)[0])) in TIME_WORDS]
    if not plain:
        if not np.array_equal(raw.t, np.arange(len(raw))):
            return raw.t, []
        raise DataError("there is no time column", where=where, next_step=_without_time(list(raw.values)))
    repairs = (
        [f"There are several time columns ({', '.join(plain)}); the first was used."]
        if len(plain) > 1
        else []
    )
    t, sentences = _seconds(plain[0], raw[plain[0]][:, 0], rate, where)
    return t, [*repairs, *sentences]


def _without_time(headers: list[str]) -> str:
    """Next step if no header names a time."""
    like = [name for name in headers if set(re.split(r"[^a-z]+", name.lower())) & LIKE_TIME]
    guess = f"Is it {' or '.join(like[:3])}? " if like else ""
    return (
        f"{guess}Name it one of {', '.join(TIME_WORDS)}, in the file or in the table [log.columns] of "
        "campaign.toml; if there is none and rows are equally spaced, state the rows per second in its "
        f"[log]: rate = 500. The file has {', '.join(headers[:40])}."
    )


def _seconds(header: str, values: Array, rate: float, where: str) -> tuple[Array, list[str]]:
    finite = values[np.isfinite(values)]
    if len(finite) < 2:
        raise DataError(
            "the time column has no numbers",
            where=f"{where}, column {header}",
            next_step="Write time as a number of seconds.",
        )
    bare, unit = split_unit(header)
    factors = {**TIME_UNITS, **MINUTES}
    stated = unit or next((u for u in (*factors, *TIME_SPELLINGS) if normal(bare).endswith(f"_{u}")), "")
    stated = TIME_SPELLINGS.get(stated, stated)
    factor, name = (factors[stated], stated) if stated in factors else time_factor(finite, rate, where)
    if stated in factors:
        _check_step(finite, factor, stated, f"{where}, column {header}")
    repairs = [] if name == "s" else [f"Time was converted from {name} (column {header})."]
    if factor == 1.0:
        return values, repairs
    # Nanoseconds since 1970 lose digits when scaled: subtract the start first.
    start = finite[0] if abs(finite[0]) * factor > 1e6 else 0.0
    if start:
        repairs.append(f"Time was counted from its first row, {start:.0f} {name}.")
    return (values - start) * factor, repairs


def _check_step(t: Array, factor: float, unit: str, where: str) -> None:
    """DataError: the time step is implausible in the unit that the header states."""
    steps = np.abs(np.diff(t))
    step = factor * float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0 / FASTEST_ROWS
    if not 1.0 / FASTEST_ROWS <= step <= 1.0 / SLOWEST_ROWS:
        raise DataError(
            f"the times, in {unit} by the header, give a row every {step:.3g} s, which is implausible",
            where=where,
            next_step="Correct the unit in the header; [log.columns] can also state the unit of times.",
        )


def time_factor(t: Array, rate: float, where: str) -> tuple[float, str]:
    """Factor to seconds and the unit's name, from the typical step of t (T,) against the usual rate in Hz.

    Raises:
        DataError: no unit brings the steps within CLOCK_FACTOR of the rate.
    """
    steps = np.abs(np.diff(t))  # rows may stand from last to first
    steps = steps[steps > 0]
    if not len(steps):
        raise DataError(
            "the time never advances",
            where=f"{where}, time column",
            next_step="Export the log again, its times with more digits.",
        )
    step = float(np.median(steps))
    off = {unit: float(np.log(step * factor * rate)) for unit, factor in TIME_UNITS.items()}
    unit = min(off, key=lambda name: abs(off[name]))
    sixty = abs(abs(off["s"]) - np.log(SIXTY)) < np.log(ALIKE)
    if abs(off[unit]) <= np.log(ALIKE if sixty else CLOCK_FACTOR):
        return TIME_UNITS[unit], unit
    fact = f"the time step {step:g} fits no unit at {rate:g} Hz"
    if sixty:
        fact += f": {'60 times' if off['s'] > 0.0 else 'a 60th of'} the value in seconds"
    header = "t [min]" if sixty and off["s"] < 0.0 else "time_ms, t [s]"
    raise DataError(
        fact,
        where=f"{where}, time column",
        next_step=f"State the unit in the header ({header}), or correct the robot's rate.",
    )


def start_at_zero(log: Log) -> Log:
    """Shifts time to begin at 0 unless the log itself contains t = 0 (then earlier samples are lead-in)."""
    if log.t[0] <= 0 <= log.t[-1]:
        return log
    shifted = replace(log, t=log.t - log.t[0])
    if abs(log.t[0]) < float(np.median(np.diff(log.t))):
        return shifted
    return shifted.repaired(f"Time begins at {log.t[0]:.3f} s and was shifted to 0.")


def from_degrees(log: Log, stated: Collection[str] = ()) -> Log:
    """Every channel of angles or their rates, from degrees; all of them, but those whose unit is stated.

    Args:
        stated: names of channels whose unit the file states, which is believed.
    """
    convertible = {n: c for n, c in log.channels.items() if any(unit in ANGLES for unit in c.units)}
    values = dict(log.values)
    for name, channel in convertible.items():
        if name not in stated:
            angle = np.array([unit in ANGLES for unit in channel.units])
            values[name] = np.where(angle, np.deg2rad(log[name]), log[name])
    believed = [name for name in convertible if name in stated]
    sentences = ["Angles were converted from degrees, as asked."] if len(believed) < len(convertible) else []
    if believed:
        sentences.append(f"The file states the unit of {', '.join(believed)}, and this unit was used.")
    return replace(log, values=values).repaired(*sentences)


def check_lengths(log: Log, stated: Collection[str] = ()) -> Log:
    """Accelerations in g are converted; other lengths, and rates and attitude in degrees, are refused.

    Raises:
        DataError: a sensor is in another unit than SI.
    """
    for name in LENGTH:
        if name in log:
            log = _checked_length(log, name, LENGTH[name], name in stated)
    for name, largest in FASTEST.items():
        mean = float(np.sqrt(np.mean(log[name] ** 2))) if name in log else 0.0
        if not mean <= largest and name not in stated:
            raise _degrees(log, name, f"{name} of {mean:.3g} rad/s on average look like degrees per second")
    for name, parts in TURN.items():
        if name in log and name not in stated:
            angles = [j for j, part in enumerate(log.channels[name].parts) if part in parts]
            largest = float(np.abs(log[name][:, angles]).max(initial=0.0))
            # half a turn is the largest angle that is logged, and 5 % more may be noise
            if largest > 1.05 * np.pi:
                raise _degrees(log, name, f"the {name} reaches {largest:.4g} rad and looks like degrees")
    return log


def _degrees(log: Log, name: str, fact: str) -> DataError:
    return DataError(
        fact,
        where=f"{log.source}, {name}",
        next_step="State the unit in the header, gyro_x [deg/s] for example, or ingest the log with "
        "--degrees.",
    )


def _checked_length(log: Log, name: str, usual: float, stated: bool) -> Log:
    size = float(np.median(np.linalg.norm(log[name], axis=1)))
    if 0.5 * usual < size < 2.0 * usual:
        return log
    if not stated and 0.5 < size < 2.0:
        channel: Channel = log.channels[name]
        return log.put(channel, usual * log[name]).repaired("Accelerations were converted from g.")
    raise DataError(
        f"the accelerometer's length is {size:.3g} m/s^2, not about {usual}",
        where=f"{log.source}, {name}",
        next_step="State the unit in the header, acc_x [g] for example; cut take-off and landing away.",
    )
