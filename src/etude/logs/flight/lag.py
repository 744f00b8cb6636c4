"""How far a vehicle's motion lags behind its commands: motors take time to follow a set-point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError
from etude.logs.derivatives import median_rate
from etude.logs.flight.log import FlightLog

Array = NDArray[np.float64]

STATES = ("specific_force", "rates", "angular_acceleration", "velocity", "altitude")
LONGEST_LAG = 0.2  # s: no motor of a vehicle that flies is slower


def command_lag(*logs: FlightLog, longest: float = LONGEST_LAG) -> float:
    """The lag in [0, longest] s at which the motion explains the commands best, s.

    The commands of `lag` ago are fitted by least squares with the motion now (all that every state tells) and
    a constant for each flight; the lag that leaves the least squares wins, refined by a parabola. Levels are
    compared, as a model learns them. Rates of change weigh noise and the quickest motion, which a motor with
    a time constant lags less: on real flights the lag they gave left models more error.

    Args:
        logs: of one vehicle, whose lag they share. Those that are too slow or short to tell have no say.

    Returns:
        0 if no log can tell.
    """
    able = [log for log in logs if 1 <= int(longest * median_rate(log.t)) < len(log) / 20.0 - 1.0]
    if not able:
        return 0.0
    rate = min(median_rate(log.t) for log in able)
    lags = np.arange(int(longest * rate) + 1) / rate
    names = [name for name in STATES if all(getattr(log.states, name) is not None for log in able)]
    Q = np.linalg.qr(np.concatenate([_centred(_motion(log, names)[_late(log, longest)]) for log in able]))[0]
    left = np.array([_residual(Q, np.concatenate([_earlier(log, k, longest) for log in able])) for k in lags])
    best = int(np.argmin(left))
    return float((best + _vertex(left, best)) / rate)


def without_lag(log: FlightLog, lag: float) -> FlightLog:
    """The log whose commands are those of `lag` s earlier; the samples before the first such are cut.

    Raises:
        DataError: the flight is shorter than the lag.
    """
    if lag == 0.0:
        return log
    kept = log.t - lag >= log.t[0]
    if not kept.any():
        raise DataError(f"the flight is shorter than a lag of {lag:g} s", where=log.source)
    command = np.column_stack([np.interp(log.t[kept] - lag, log.t, column) for column in log.command.T])
    return replace(
        log,
        t=log.t[kept],
        states=log.states.take(kept),
        command=command,
        position=None if log.position is None else log.position[kept],
        position_des=None if log.position_des is None else log.position_des[kept],
    )


def _motion(log: FlightLog, names: list[str]) -> Array:
    """(T, m) the quantities of the states in `names`."""
    parts = [getattr(log.states, name) for name in names]
    return np.column_stack(parts)


def _late(log: FlightLog, longest: float) -> NDArray[np.bool_]:
    """(T,) samples whose commands of `longest` ago are recorded: the same for every lag."""
    return np.asarray(log.t >= log.t[0] + longest)


def _earlier(log: FlightLog, lag: float, longest: float) -> Array:
    """(n, 4) commands of `lag` before the late samples, centred."""
    at = log.t[_late(log, longest)] - lag
    return _centred(np.column_stack([np.interp(at, log.t, column) for column in log.command.T]))


def _centred(values: Array) -> Array:
    return np.asarray(values - values.mean(axis=0))


def _residual(Q: Array, Y: Array) -> float:
    """Part of Y's squares outside the range of Q, mean over the commands."""
    inside = ((Q.T @ Y) ** 2).sum(axis=0)
    whole = np.maximum((Y * Y).sum(axis=0), np.finfo(float).tiny)
    return float(np.mean(1.0 - inside / whole))


def _vertex(values: Array, best: int) -> float:
    """Place of the parabola's bottom through three values, relative to the middle one."""
    if not 0 < best < len(values) - 1:
        return 0.0
    a, b, c = values[best - 1 : best + 2]
    bend = a - 2.0 * b + c
    return 0.0 if bend <= 0.0 else float(0.5 * (a - c) / bend)
