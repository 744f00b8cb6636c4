"""What a motion has to teach: noise and what differentiation makes of it, rest, coverage, delay."""

from __future__ import annotations

import numpy as np

from etude.logs.checks.seen import LEAST_ROWS, RATE, Seen
from etude.logs.checks.words import named
from etude.logs.cleaning.filters import longest_stretch
from etude.logs.cleaning.lag import LONGEST_LAG, command_lag
from etude.logs.cleaning.smoothing import median_rate, resample, uniform_grid
from etude.logs.columns.units import Limits
from etude.types import Array, Channel, Finding, Log

NOISY = 0.3  # deviation of the acceleration's noise over that of the acceleration
THIRD = 20.0  # variance of the third difference of white noise
STANDING, SMALL = 0.8, 0.2  # of the time; of the limits
LATE_S, LATEST_S, LATEST = 0.05, 1.0, 1.0 / 25.0  # s, s, and of the log
SAME_CLOCK = "Log command and position with stamps of the same clock."


def motion_findings(log: Log, path: Channel, motion: Seen, limits: Limits) -> tuple[Finding, ...]:
    """Of the coordinates `path` of a log whose rows are in order and hold numbers."""
    found = [_noise(log, path, motion)]
    if motion.moves.any():
        found.append(_rest(motion))
    if not _commanded_elsewhere(log, path):
        found.append(_delay(motion, path))
    if path.name in limits:
        found.append(_coverage(log, path, motion, limits))
    return tuple(found)


def _commanded_elsewhere(log: Log, path: Channel) -> bool:
    """Whether all commands act on something else than these positions: a vehicle's motors."""
    commands = [c for c in log.channels.values() if c.role == "command" and c.name in log]
    return bool(commands) and all(c.acts_on != path.name for c in commands)


def _noise(log: Log, path: Channel, motion: Seen) -> Finding:
    part = longest_stretch(log)
    rate = median_rate(part.t)
    grid = uniform_grid(part.t, rate)
    q = resample(part.t, part[path.name], grid)
    if len(grid) < 4 * LEAST_ROWS or not motion.moves.any():
        return Finding("noise", "cannot tell", "There is too little motion to tell noise from.")
    level = np.sqrt(np.mean(np.diff(q, 3, axis=0) ** 2, axis=0) / THIRD)
    raw, kept = np.sqrt(6.0) * level * rate**2, level * _passed(rate, motion.cutoff)
    size = motion.qdd.std(axis=0)
    share = np.where(motion.moves, kept / np.where(size > 0.0, size, np.inf), 0.0)
    worst = int(np.argmax(share))
    unit = path.units[worst]
    said = (
        f"Positions of {path.parts[worst]} are noisy by {level[worst]:.2g} {unit}; differentiated twice "
        f"that is {raw[worst]:.2g} {unit}/s^2, behind the filter of {motion.cutoff:.3g} Hz "
        f"{kept[worst]:.2g}, where the motion has {size[worst]:.2g}."
    )
    if share[worst] < NOISY:
        return Finding("noise", "green", said)
    return Finding("noise", "yellow", said, "Move faster, or log positions with more digits and less noise.")


def _passed(rate: float, cutoff: float) -> float:
    """Deviation of the second derivative behind the filter, per deviation of white noise at that rate."""
    f = np.linspace(0.0, 0.5 * rate, 2001)
    density = (2.0 * np.pi * f) ** 4 / (1.0 + (f / cutoff) ** 4) ** 2
    return float(np.sqrt(density.mean()))


def _rest(motion: Seen) -> Finding:
    share = 1.0 - motion.moving.mean(axis=0)
    never, long = ~motion.moves, motion.moves & (share > STANDING)
    said = f"Joints stand for {100 * share.min():.0f} to {100 * share.max():.0f} % of the time."
    if never.any():
        said = f"{named(motion.parts, never)} never move{'s'[: int(never.sum()) == 1]}. {said}"
    elif not long.any():
        return Finding("rest", "green", said)
    return Finding("rest", "yellow", said, "Move every joint that is to be learned, and more of the time.")


def _coverage(log: Log, path: Channel, motion: Seen, limits: Limits) -> Finding:
    lower, upper = limits[path.name]
    share = np.ptp(log[path.name], axis=0) / (upper - lower)
    said = f"Positions cover {100 * share.min():.0f} to {100 * share.max():.0f} % of their limits"
    top = limits.get(f"{path.name}d")
    if top is not None:
        fast = np.abs(motion.qd).max(axis=0) / np.abs(top[1])
        said += f", speeds reach {100 * fast.min():.0f} to {100 * fast.max():.0f} %"
    small = share < SMALL
    if not small.any():
        return Finding("coverage", "green", f"{said}.")
    said += f"; little is seen of {named(motion.parts, small)}."
    return Finding(
        "coverage", "yellow", said, "A model knows what it was shown: etude ask proposes the rest."
    )


def _delay(motion: Seen, path: Channel) -> Finding:
    """How far the motion is behind the commands, to a fraction of a row at 50 Hz."""
    if motion.command is None or not motion.moves.any():
        return Finding("delay", "cannot tell", "No commands of moving joints are logged.")
    own = np.flatnonzero(motion.moves)
    log = Log(np.asarray(motion.step * np.arange(len(motion.t)), dtype=np.float64), {}, {}, "seen")
    parts = tuple(path.parts[j] for j in own)
    commands: Array = motion.command[:, own]
    log = log.put(Channel("command", parts, ("",) * len(own), "command"), commands)
    for name, values in (("q", motion.q), ("qd", motion.qd), ("qdd", motion.qdd)):
        log = log.put(Channel(name, parts, ("",) * len(own)), values[:, own])
    rubbing = np.tanh(motion.qd[:, own] / (0.05 * np.abs(motion.qd[:, own]).max(axis=0)))
    log = log.put(Channel("rubbing", parts, ("",) * len(own)), rubbing)
    states = ("q", "qd", "qdd", "rubbing")
    lag = command_lag([log], states)
    if lag >= LONGEST_LAG - motion.step:  # the best of those tried is no best one: a longer delay, or none
        longest = min(LATEST_S, LATEST * motion.step * len(motion.t))
        lag = command_lag([log], states, longest) if longest > LONGEST_LAG else longest
        if lag < longest - motion.step:
            return Finding("delay", "yellow", _behind(lag), SAME_CLOCK)
        return Finding("delay", "cannot tell", "The motion is too slow to tell how far it is behind.")
    if lag < LATE_S:
        return Finding("delay", "green", _behind(lag))
    return Finding("delay", "yellow", _behind(lag), SAME_CLOCK)


def _behind(lag: float) -> str:
    return f"The motion is {1e3 * lag:.0f} ms behind the commands (to {500.0 / RATE:.0f} ms)."
