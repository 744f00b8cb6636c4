"""Wrong logs by mutation: what was done to a log, and what the truth tests have to say of it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from etude.types import Array, Log, Mask

STANDING_S = 3.0
JUMPS = {"rad": 0.5, "m": 1.0}
"""By how much a position jumps: an encoder that was referenced again, an estimator that was reset."""
GRAVITY = 9.81
"""m/s^2."""


@dataclass(frozen=True)
class Wrong:
    """One mutation of one log.

    Attributes:
        error: "sign", "x2", "x60", "reversed", "degrees", "swapped", "ground", "jump", or a check of the
            numbers alone.
        check: of the finding that tells it.
        made: the log so mutated.
        part: of the joint, or the pair; -1: of the whole log.
        order: of the commands' columns by which a swap is undone; () of other errors.
        says: words of which one has to stand in the sentence.
    """

    error: str
    check: str
    made: Callable[[Log], Log]
    part: int = -1
    order: tuple[int, ...] = ()
    says: tuple[str, ...] = ()


def wrongs(log: Log, path: str, moves: Mask) -> Iterator[Wrong]:
    """Every mutation of a log; signs and swaps of the joints that move."""
    if path == "q":
        joints = np.flatnonzero(moves).tolist()
        for j in joints:
            yield Wrong("sign", "sign", partial(_turned, j=j), j)
        for a, b in itertools.combinations(joints, 2):
            order = list(range(len(moves)))
            order[a], order[b] = b, a
            yield Wrong("swapped", "swapped", partial(_ordered, order=order), a, tuple(order))
        yield Wrong("degrees", "degrees", lambda log: _in_degrees(log, "q"), says=("degrees",))
        if "qd" in log:
            yield Wrong("degrees", "degrees", lambda log: _in_degrees(log, "qd"), says=("degrees",))
            yield Wrong("degrees", "degrees", lambda log: _in_degrees(log, "q", "qd"), says=("degrees",))
    else:
        yield Wrong("degrees", "degrees", lambda log: _in_degrees(log, "rates"), says=("degrees",))
        yield Wrong("ground", "ground", _landed, says=("on the ground",))
    yield from recorded_wrong(log)
    for j in np.flatnonzero(moves).tolist() if path in log else ():
        yield Wrong("jump", "jump", partial(_jumping, path=path, j=j), j, says=("jumps",))
    slow, fast = ("times too slow",), ("times too fast",)
    yield Wrong("x2", "time", lambda log: replace(log, t=2.0 * log.t), says=slow)
    yield Wrong("x2", "time", lambda log: replace(log, t=0.5 * log.t), says=fast)
    yield Wrong("x60", "time", lambda log: replace(log, t=60.0 * log.t), says=slow)
    yield Wrong("x60", "time", lambda log: replace(log, t=log.t / 60.0), says=fast)
    yield Wrong("reversed", "direction", _backwards, says=("backwards",))


HELD_ROWS = (2.0, 1.6, 4.0)
"""Rows for which each value of a slower sensor stands."""
COMMANDS_HZ = 10.0
OFF_S = 1.0
WRAPS_AT = 0.8
"""Of a command's largest: where an integer overflows."""
LOST = (0.01, 0.03, 0.1)
"""Shares of the rows."""


def recorded_wrong(log: Log) -> Iterator[Wrong]:
    """What the numbers alone tell; of an arm more than of a vehicle."""
    for rows in HELD_ROWS:
        yield Wrong("held", "held", partial(_held, rows=rows, names=tuple(log.values)))
    if log.channels["command"].acts_on not in log:
        return
    rate = 1.0 / float(np.median(np.diff(log.t)))
    slow = partial(_held, rows=round(rate / COMMANDS_HZ), names=("command",))
    yield Wrong("held_commands", "held_commands", slow)
    yield Wrong("unsigned", "unsigned", lambda log: _commanding(log, np.abs(log["command"])))
    yield Wrong("off", "off", partial(_off, rows=round(rate * OFF_S)))
    yield Wrong("copied", "copied", _copied)
    yield Wrong("turns", "turns", _wrapped)
    yield Wrong("overflow", "overflow", _overflown)
    for share in LOST:
        yield Wrong("lost", "lost", partial(_lost, share=share))


def _held(log: Log, rows: float, names: tuple[str, ...]) -> Log:
    index = np.floor(np.floor(np.arange(len(log)) / rows + 1e-9) * rows + 1e-9).astype(np.int64)
    return replace(log, values={n: v[index] if n in names else v for n, v in log.values.items()})


def _commanding(log: Log, command: Array) -> Log:
    return log.put(log.channels["command"], command)


def _off(log: Log, rows: int) -> Log:
    """Without commands for a while, after a third of the log."""
    command = log["command"].copy()
    command[len(log) // 3 :][:rows] = 0.0
    return _commanding(log, command)


def _copied(log: Log) -> Log:
    command = log["command"].copy()
    command[:, 1] = command[:, 0]
    return _commanding(log, command)


def _wrapped(log: Log) -> Log:
    """Angles within half a turn of 0, which their mean is half a turn away from."""
    turn = 2.0 * np.pi
    return log.put(log.channels["q"], (log["q"] - log["q"].mean(axis=0) + turn) % turn - 0.5 * turn)


def _overflown(log: Log) -> Log:
    command = log["command"].copy()
    j = int(np.argmax(np.abs(command).max(axis=0)))
    top = WRAPS_AT * np.abs(command[:, j]).max()
    command[:, j] = (command[:, j] + top) % (2.0 * top) - top
    return _commanding(log, command)


def _lost(log: Log, share: float) -> Log:
    """Less some rows, with times that count rows."""
    left = log.take(np.random.default_rng(0).random(len(log)) > share)
    return replace(left, t=log.t[0] + float(np.median(np.diff(log.t))) * np.arange(len(left)))


def _turned(log: Log, j: int) -> Log:
    signs = np.ones(log["command"].shape[1])
    signs[j] = -1.0
    return log.put(log.channels["command"], log["command"] * signs)


def _ordered(log: Log, order: list[int]) -> Log:
    return log.put(log.channels["command"], np.ascontiguousarray(log["command"][:, order]))


def _in_degrees(log: Log, *names: str) -> Log:
    """Those channels in degrees; a flight less the derivative of its rates, which recorders do not write."""
    values = {name: np.rad2deg(part) if name in names else part for name, part in log.values.items()}
    return replace(log, values=values).without("angular_acceleration")


def _backwards(log: Log) -> Log:
    return replace(log, values={name: part[::-1].copy() for name, part in log.values.items()})


def _jumping(log: Log, path: str, j: int) -> Log:
    """One position elsewhere from the middle of the log on; its velocity goes on as it was."""
    values = log[path].copy()
    values[len(log) // 2 :, j] += JUMPS[log.channels[path].units[j]]
    return log.put(log.channels[path], values)


def _landed(log: Log) -> Log:
    """The flight after some seconds on the ground, with a sensor's noise."""
    step = float(np.median(np.diff(log.t)))
    count = int(STANDING_S / step)
    rng = np.random.default_rng(0)
    first = {name: np.repeat(part[:1], count, axis=0) for name, part in log.values.items()}
    first["command"] = np.zeros_like(first["command"])
    first["rates"] = 0.004 * rng.standard_normal(first["rates"].shape)
    first["specific_force"] = np.array([0.0, 0.0, GRAVITY]) + 0.02 * rng.standard_normal((count, 3))
    t = np.concatenate([log.t[0] + step * (np.arange(count) - count), log.t])
    return replace(log, t=t, values={n: np.concatenate([first[n], part]) for n, part in log.values.items()})
