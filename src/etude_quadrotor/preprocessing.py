"""Preprocessing of recorded flights into samples: states, lag, rate and trimming."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from etude.errors import DataError
from etude.logs.cleaning.filters import command_lag, median_rate, sampled, saturated, trimmed, without_lag
from etude.types import Array, Index, Log, Samples, joined_samples
from etude_quadrotor.battery import slow_voltage
from etude_quadrotor.config import FlightData
from etude_quadrotor.recorder import on_even_grid, with_states
from etude_quadrotor.spec import QuadrotorSpec

FAST, FAST_HZ = 2.0, 50.0
"""Least samples of the log per sample of the model to identify a lag, and the rate that suffices in any case.
In slow flights at 10 Hz, single logs gave 0 to 200 ms for a vehicle with 50 ms.
"""
LAGGING = ("specific_force", "rates", "angular_acceleration", "body_velocity", "altitude")
"""States of the motion that commands cause."""
MOST_SATURATED = 0.95  # part of a log: with more saturated rows the rest is not informative
KEPT = ("state", "command", "plan", "truth")
"""Roles of channels that samples have; beside them the position."""


def flight_samples(
    spec: QuadrotorSpec, data: FlightData, logs: Sequence[Log], groups: Sequence[Index]
) -> Samples:
    """The samples of flights at the vehicle's model rate, by group and time.

    The commands are those of one lag earlier; all flights give the lag together. A state that one flight
    lacks is left out for all.

    Args:
        spec: the vehicle. data: the configuration.
        logs: on uniform grids.
        groups: (T,) segment of each row, for each log.

    Raises:
        DataError: no log or no sample remains, NaN, commands in different units, saturated throughout, or
            constant.
    """
    _check_logs(logs)
    prepared = [slow_voltage(with_states(on_even_grid(log))) for log in logs]
    lag = common_lag(prepared, spec, data)
    parts = [
        _flight(log, raw.t, group, spec, data, lag)
        for log, raw, group in zip(prepared, logs, groups, strict=True)
    ]
    joined = joined_samples(parts)
    if not np.ptp(joined.command, axis=0).any():
        raise DataError(
            "no command ever changes, so nothing can be learned",
            where=logs[0].source,
            next_step="Check that the log contains the commands that were sent.",
        )
    notes = (
        ()
        if lag == 0.0
        else (f"The motion lags {lag:.3g} s behind the commands; the commands were shifted.",)
    )
    ordered = joined.take(np.lexsort((joined.t, joined.group)))
    return replace(ordered, log=ordered.log.repaired(*notes))


def common_lag(logs: Sequence[Log], spec: QuadrotorSpec, data: FlightData) -> float:
    """Lag of the vehicle behind its commands, s, from all its flights (with states) together."""
    if data.lag_s != "auto":
        return data.lag_s
    least = min(FAST * spec.rate, FAST_HZ)  # a robot file that states the log's own rate loses no lag
    return command_lag([log for log in logs if median_rate(log.t) >= least], LAGGING)


def _check_logs(logs: Sequence[Log]) -> None:
    if not logs:
        raise DataError("there is no flight for training", next_step="Fly one and ingest its log.")
    units = {log.channels["command"].units for log in logs}
    if len(units) > 1:
        raise DataError(
            "the flights give their commands in different units",
            where=", ".join(sorted({unit for several in units for unit in several})),
            next_step="Use flights of one vehicle.",
        )
    for log in logs:
        _finite("t", log.t, log.source)


def _flight(
    log: Log, recorded: Array, group: Index, spec: QuadrotorSpec, data: FlightData, lag: float
) -> Samples:
    """One flight: lag, rate, trimming and checks; each sample in the segment of the recorded row at or after
    its time.
    """
    names = [n for n, c in log.channels.items() if c.role not in KEPT and n != "position"]
    log = sampled(without_lag(log.without(*names), lag), spec.rate, averaged=data.averaged)
    part = trimmed(log, data.first_s, data.last_s)
    for name, values in part.values.items():
        if part.channels[name].role in ("state", "command"):
            _finite(name.replace("_", " "), values, log.source)
    _check_saturation(part, spec)
    segments = group[np.minimum(np.searchsorted(recorded, part.t), len(group) - 1)]
    every = np.ones(part["command"].shape, dtype=np.bool_)
    return Samples(replace(part, t=part.t - log.t[0]), segments, every, every.copy())


def _check_saturation(log: Log, spec: QuadrotorSpec) -> None:
    lower, upper = np.array(spec.command_lower), np.array(spec.command_upper)
    if saturated(log["command"], lower, upper).any(axis=1).mean() > MOST_SATURATED:
        raise DataError(
            "the commands are always saturated, so they do not show the need of the motion",
            where=log.source,
            next_step="Fly slower, or correct the limits of the commands.",
        )


def _finite(name: str, values: Array, where: str) -> None:
    if not np.isfinite(values).all():
        raise DataError(
            f"the flight's {name} contains NaN or infinite values",
            where=where,
            next_step="Repair the log, or trim these samples.",
        )
