"""Wrong logs by mutation: what was done to a log, and what the truth tests have to say of it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from etude.types import Log, Mask

STANDING_S = 3.0
JUMPS = {"rad": 0.5, "m": 1.0}
"""By how much a position jumps: an encoder that was referenced again, an estimator that was reset."""
GRAVITY = 9.81
"""m/s^2."""


@dataclass(frozen=True)
class Wrong:
    """One mutation of one log.

    Attributes:
        error: "right", "sign", "x2", "x60", "reversed", "degrees", "swapped", "ground" or
            "jump".
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
        own = np.flatnonzero(moves).tolist()
        for j in own:
            yield Wrong("sign", "sign", partial(_turned, j=j), j)
        for a, b in itertools.combinations(own, 2):
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
    for j in np.flatnonzero(moves).tolist() if path in log else ():
        yield Wrong("jump", "jump", partial(_jumping, path=path, j=j), j, says=("jumps",))
    slow, fast = ("times too slow",), ("times too fast",)
    yield Wrong("x2", "time", lambda log: replace(log, t=2.0 * log.t), says=slow)
    yield Wrong("x2", "time", lambda log: replace(log, t=0.5 * log.t), says=fast)
    yield Wrong("x60", "time", lambda log: replace(log, t=60.0 * log.t), says=slow)
    yield Wrong("x60", "time", lambda log: replace(log, t=log.t / 60.0), says=fast)
    yield Wrong("reversed", "direction", _backwards, says=("backwards",))


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
