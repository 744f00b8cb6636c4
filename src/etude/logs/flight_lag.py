"""How far a vehicle's motion lags behind its commands: motors take time to follow a set-point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError
from etude.logs.derivatives import median_rate
from etude.logs.flight_log import FlightLog
from etude.trajectories.flight_states import FlightStates

Array = NDArray[np.float64]

LONGEST_LAG = 0.2  # s: no motor of a vehicle that flies is slower


def command_lag(log: FlightLog, longest: float = LONGEST_LAG) -> float:
    """The lag in [0, longest] s at which the motion explains the commands best, s.

    The commands of `lag` ago are fitted by least squares with the motion now (specific force, rates, angular
    acceleration and a constant); the lag with the least squares left wins, refined by a parabola. Rates of
    change are compared, so that slow drifts do not count. Zero if the log is too slow to tell.
    """
    rate = median_rate(log.t)
    steps = int(longest * rate)
    if steps < 1 or len(log) < 20 * (steps + 1):
        return 0.0
    X = np.diff(_regressors(log.states), axis=0)
    Y = np.diff(log.command, axis=0)
    Q = np.linalg.qr(X[steps:])[0]
    left = np.array([_residual(Q, Y[steps - k : len(Y) - k]) for k in range(steps + 1)])
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


def _regressors(states: FlightStates) -> Array:
    return np.hstack([states.specific_force, states.rates, states.angular_acceleration])


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
