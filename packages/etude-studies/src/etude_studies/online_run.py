"""A run of several passes of one motion, watched: what each tick of a controller cost and left."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError
from etude.protocols import Trajectory
from etude.types import Array, Log, Motion, Row
from etude_online import OnlineModel


@dataclass(frozen=True, eq=False)
class Repeated:
    """A motion that ends where it starts, several times over (a `protocols.Trajectory`).

    Raises:
        UsageError: less than one pass.
    """

    once: Trajectory
    passes: int

    def __post_init__(self) -> None:
        if self.passes < 1:
            raise UsageError(f"{self.passes} passes of a motion", next_step="Give one or more.")

    @property
    def form(self) -> str:
        return self.once.form

    @property
    def duration(self) -> float:
        """s, of all passes."""
        return self.passes * self.once.duration

    def motion(self, t: Array, orders: int = 3) -> Motion:
        """Of times t (T,) s in any pass."""
        number = np.floor(t / self.once.duration + 1e-9)
        return Motion(t, self.once.motion(t - number * self.once.duration, orders).orders)

    def pieces(self) -> tuple[tuple[float, str, Trajectory], ...]:
        """A pass each."""
        return tuple((k * self.once.duration, "segment", self.once) for k in range(self.passes))

    def bound(self, order: int, degree: int) -> tuple[Array, Array, float]:
        return self.once.bound(order, degree)

    def slowed(self, factor: float) -> Repeated:
        return Repeated(self.once.slowed(factor), self.passes)

    def to_json(self) -> str:
        """That of one pass."""
        return self.once.to_json()


@dataclass(eq=False)
class Watched:
    """A controller that keeps count of itself (implements `protocols.Controller`).

    Attributes:
        own: what is watched.
        spent: by method, processor seconds of each tick. counts: samples learned in each tick.
        mixed: (J,) of each tick, part of each command that came from its learner.
    """

    own: OnlineModel
    spent: dict[str, list[float]] = field(default_factory=lambda: {"command": [], "observe": []})
    counts: list[int] = field(default_factory=list)
    mixed: list[list[float]] = field(default_factory=list)

    def planned(self, motion: Motion) -> Array | None:
        """None: it is asked tick by tick."""
        return self.own.planned(motion)

    def command(self, t: float, row: Row) -> tuple[Array, Array]:
        start = time.thread_time()
        output = self.own.command(t, row)
        self.spent["command"].append(time.thread_time() - start)
        self.mixed.append(self.own.weights())
        return output

    def observe(self, t: float, row: Row) -> None:
        before, start = int(self.own.counts.learned.sum()), time.thread_time()
        self.own.observe(t, row)
        self.spent["observe"].append(time.thread_time() - start)
        self.counts.append(int(self.own.counts.learned.sum()) - before)

    def times(self, method: str) -> Array:
        """(T,) s that each tick spent in "command" or "observe"."""
        return np.array(self.spent[method])

    @property
    def learned(self) -> NDArray[np.int64]:
        """(T,) samples learned in each tick."""
        return np.array(self.counts, dtype=np.int64)

    @property
    def weights(self) -> Array:
        """(T, J) part of each command that came from its learner."""
        return np.array(self.mixed)


@dataclass(frozen=True, eq=False)
class OnlineRun:
    """What happened.

    Attributes:
        log: of all passes; t is 0 where the first begins. count: of passes.
        watched: the controller; None without updates.
    """

    log: Log
    count: int
    watched: Watched | None = None

    def passes(self) -> Iterator[Log]:
        """The log of each pass."""
        moving = np.flatnonzero(self.log.t >= 0.0)
        return (self.log.take(part) for part in np.array_split(moving, self.count))
