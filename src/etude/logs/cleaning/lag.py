"""How far a robot's motion lags behind its commands: motors take time to follow a set-point."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.errors import DataError
from etude.logs.cleaning.smoothing import median_rate, resample
from etude.types import Array, Log, Mask

LONGEST_LAG = 0.2  # s: no motor of a vehicle that flies is slower


def command_lag(logs: Sequence[Log], states: Sequence[str], longest: float = LONGEST_LAG) -> float:
    """The lag in [0, longest] s at which the motion explains the commands best, s.

    The commands of `lag` ago are fitted by least squares with the motion now (all that every state tells) and
    a constant for each log; the lag that leaves the least squares wins, refined by a parabola. Levels are
    compared, as a model learns them. Rates of change weigh noise and the quickest motion, which a motor with
    a time constant lags less: on real flights the lag they gave left models more error.

    Args:
        logs: of one robot, whose lag they share. Those that are too slow or short to tell have no say.
        states: channels that tell of the motion; those that a log lacks are left out of all.
        longest: s.

    Returns:
        0 if no log can tell.
    """
    able = [log for log in logs if 1 <= int(longest * median_rate(log.t)) < len(log) / 20.0 - 1.0]
    names = [name for name in states if all(name in log for log in able)]
    if not able or not names:
        return 0.0
    rate = min(median_rate(log.t) for log in able)
    lags = np.arange(int(longest * rate) + 1) / rate
    Q = np.linalg.qr(np.concatenate([_centred(_motion(log, names)[_late(log, longest)]) for log in able]))[0]
    left = np.array([_residual(Q, np.concatenate([_earlier(log, k, longest) for log in able])) for k in lags])
    best = int(np.argmin(left))
    return float((best + _vertex(left, best)) / rate)


def without_lag(log: Log, lag: float) -> Log:
    """The log whose commands are those of `lag` s earlier; the samples before the first such are cut.

    Raises:
        DataError: the log is shorter than the lag.
    """
    if lag == 0.0:
        return log
    kept = log.t - lag >= log.t[0]
    if not kept.any():
        raise DataError(f"the log is shorter than a lag of {lag:g} s", where=log.source)
    command = resample(log.t, log["command"], log.t[kept] - lag)
    return log.take(kept).put(log.channels["command"], command)


def _motion(log: Log, names: Sequence[str]) -> Array:
    """(T, m) the quantities of the channels in `names`."""
    return np.column_stack([log[name] for name in names])


def _late(log: Log, longest: float) -> Mask:
    """(T,) samples whose commands of `longest` ago are recorded: the same for every lag."""
    return np.asarray(log.t >= log.t[0] + longest)


def _earlier(log: Log, lag: float, longest: float) -> Array:
    """(n, J) commands of `lag` before the late samples, centred."""
    return _centred(resample(log.t, log["command"], log.t[_late(log, longest)] - lag))


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
