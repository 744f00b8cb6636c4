"""What every trajectory is: a pure function of time that yields joint positions and exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TrajectorySamples:
    """A trajectory at given times.

    Attributes:
        t: (T,) times in s.
        q, qd, qdd, qddd: (T, dof) position, velocity, acceleration, jerk; rad (or m for a slide) and s.
    """

    t: Array
    q: Array
    qd: Array
    qdd: Array
    qddd: Array


class Trajectory(Protocol):
    """The contract of `trajectories/`."""

    @property
    def dof(self) -> int: ...

    @property
    def duration(self) -> float:
        """Length in s; `sample` is defined on [0, duration] and rests outside it."""
        ...

    def sample(self, t: Array) -> TrajectorySamples:
        """Samples at times t (T,) in s."""
        ...
