"""Input of the plausibility checks: a motion and its commands through one filter, 50 Hz at most."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude.logs.cleaning.filters import auto_cutoff, longest_stretch, looked_at
from etude.logs.cleaning.smoothing import (
    Smoothed,
    median_rate,
    quick_length,
    resample,
    segments,
    smooth,
    uniform_grid,
)
from etude.types import Array, Channel, Log, Mask

RATE = 50.0  # Hz: what a motion holds beyond is noise
MOVING = 0.05  # of a joint's top speed: below, it stands, and friction says nothing
LEAST_ROWS = 8  # of a stretch that can be filtered
WILD = 10.0  # times the step that 99 % of the rows stay below: there and back again is no motion
NO_MOTION = 1e-9  # rad or m: positions that differ by less are the same
ABOVE = 4.0  # times the noise: a filtered position that varies by less does not move
SHAKEN = 0.005  # of the largest travel in its unit, 1 rad or m at most: a smaller one is vibration


@dataclass(frozen=True, eq=False)
class Seen:
    """A motion and its commands; n rows, k joints, SI units.

    Attributes:
        t: (n,) s. step: s between rows.
        q, qd, qdd: (n, k) filtered position and its derivatives.
        logged: (n, k) the logged velocity after the same filter; None if it was not logged.
        command: (n, k) after the same filter; None if commands do not act on these coordinates.
        moving: (n, k) where a joint is faster than MOVING of its top speed.
        parts, units: of the positions.
        cutoff: Hz of the filter.
    """

    t: Array
    step: float
    q: Array
    qd: Array
    qdd: Array
    logged: Array | None
    command: Array | None
    moving: Mask
    parts: tuple[str, ...]
    units: tuple[str, ...]
    cutoff: float

    @property
    def moves(self) -> Mask:
        """(k,) which joints move at all."""
        return np.asarray(self.moving.any(axis=0))

    @property
    def seconds(self) -> Array:
        """(k,) s for which each joint moves."""
        return np.asarray(self.step * self.moving.sum(axis=0), dtype=np.float64)


def seen(log: Log, path: Channel) -> Seen | None:
    """The filtered motion of the coordinates `path`; None if the log has no stretch to filter.

    All channels pass the filter chosen for the positions, so that their phases agree. Of a very long log only
    some stretches are used.
    """
    log = looked_at(log)
    channels = [c for c in log.channels.values() if c.name in log]
    others: dict[str, Channel] = {
        c.role: c for c in channels if c.role == "command" and c.acts_on == path.name
    }
    logged = next((c for c in channels if _rate_of(c, path)), None)
    others |= {} if logged is None else {"logged": logged}
    pieces = [piece for piece in segments(log.t) if piece.stop - piece.start >= LEAST_ROWS]
    if path.name not in log or not pieces:
        return None
    for name in (path.name, *(c.name for c in others.values())):
        log = _without_outliers(log, name)
    rate, cutoff = median_rate(log.t), _cutoff(log, path.name)
    keep = max(1, math.ceil(rate / RATE - 1e-6))
    parts = [_stretch(log.take(piece), rate, cutoff, keep, path, others) for piece in pieces]
    names = [name for name in parts[0] if all(name in part for part in parts)]
    whole = {name: np.concatenate([part[name] for part in parts]) for name in names}
    travel = np.ptp(whole["q"], axis=0)
    still = np.maximum(ABOVE * noise(log[path.name]), SHAKEN * np.minimum(_largest_travel(travel, path), 1.0))
    moved = travel > np.maximum(NO_MOTION, still)
    speed = np.abs(whole["qd"])
    return Seen(
        whole["t"],
        keep / rate,
        whole["q"],
        whole["qd"],
        whole["qdd"],
        whole.get("logged"),
        whole.get("command"),
        np.asarray((speed > MOVING * speed.max(axis=0)) & moved),
        path.parts,
        path.units,
        cutoff,
    )


def _largest_travel(travel: Array, path: Channel) -> Array:
    """(k,) for each coordinate the largest travel of all coordinates in its unit."""
    return np.array(
        [max(w for w, u in zip(travel, path.units, strict=True) if u == unit) for unit in path.units]
    )


def states_of(t: Array, path: Channel, q: Array, qd: Array, qdd: Array) -> Log:
    """A motion as a log of states, for a mean to predict commands of."""
    log = Log(t, {}, {}, "seen").put(path, q)
    for name, values in ((f"{path.name}d", qd), (f"{path.name}dd", qdd)):
        log = log.put(replace(path, name=name), values)
    return log


LEAST_TRAVEL = 0.04  # rad or m: a smaller motion is vibration from other joints
LEAST_SHARE, WIDEST = 0.03, 2.0  # of the largest travel, which counts up to WIDEST rad or m


def goes_far(q: Array) -> Mask:
    """(k,) whether positions q (n, k) vary by enough to test the joint's commands."""
    travel = np.ptp(q, axis=0)
    return np.asarray(travel > np.maximum(LEAST_TRAVEL, LEAST_SHARE * min(float(travel.max()), WIDEST)))


def noise(q: Array) -> Array:
    """(k,) deviation of white noise in positions q (T, k); 0 for a coarse sensor."""
    if len(q) < 3:
        return np.zeros(q.shape[1])
    middle = np.median(np.abs(np.diff(q, 2, axis=0)), axis=0)
    return np.asarray(middle / (0.6745 * math.sqrt(6.0)))


def joints(log: Log) -> Channel | None:
    """The coordinates that commands act on; None if there are none, or the log lacks them."""
    commands = [c for c in log.channels.values() if c.role == "command" and c.acts_on in log]
    return log.channels[commands[0].acts_on] if commands else None


def measured_rates(log: Log, path: Channel) -> list[str]:
    """The channel of the logged velocities, if there is one."""
    rates = (c for c in log.channels.values() if c.derivative_of == path.name and c.role != "plan")
    return [c.name for c in rates if c.name in log]


def _rate_of(channel: Channel, path: Channel) -> bool:
    is_rate = channel.derivative_of == path.name and channel.role in ("state", "aside")
    return is_rate and channel.parts == path.parts


def _without_outliers(log: Log, name: str) -> Log:
    """The log with single outliers replaced by the mean of their neighbours, so that none decides a test."""
    values = log[name]
    step = np.diff(values, axis=0)
    usual = WILD * np.quantile(np.abs(step), 0.99, axis=0)
    leap = np.abs(step) > np.maximum(usual, NO_MOTION)
    wild = leap[:-1] & leap[1:] & (step[:-1] * step[1:] < 0.0)
    if not wild.any():
        return log
    middle = 0.5 * (values[:-2] + values[2:])
    inner = np.where(wild, middle, values[1:-1])
    return log.put(log.channels[name], np.concatenate([values[:1], inner, values[-1:]]))


def _cutoff(log: Log, name: str) -> float:
    longest = longest_stretch(log)
    grid = uniform_grid(longest.t, median_rate(log.t))
    return auto_cutoff(grid, resample(longest.t, longest[name], grid))


def _stretch(
    log: Log, rate: float, cutoff: float, keep: int, path: Channel, others: Mapping[str, Channel]
) -> dict[str, Array]:
    """One stretch, every so many rows, without a filter's edge."""
    grid = uniform_grid(log.t, rate)
    grid = grid[: quick_length(len(grid))]
    edge = min(int(rate / cutoff), max((len(grid) - 2 * LEAST_ROWS) // 2, 0))
    rows = slice(edge, len(grid) - edge, keep)

    def filtered(name: str) -> Smoothed:
        return smooth(grid, resample(log.t, log[name], grid), cutoff)

    made = filtered(path.name)
    columns = {"t": grid[rows], "q": made.value[rows], "qd": made.first[rows], "qdd": made.second[rows]}
    return columns | {name: filtered(channel.name).value[rows] for name, channel in others.items()}


def runs(marked: Mask) -> Sequence[tuple[int, int]]:
    """Start and end (exclusive) of each contiguous stretch of marked rows."""
    edges = np.flatnonzero(np.diff(marked.astype(np.int8), prepend=0, append=0)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))
