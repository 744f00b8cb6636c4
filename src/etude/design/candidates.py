"""Random candidates: trajectories inside the limits, each with its own draw of what no search refines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from etude.contracts import Array, Family, Limit, Trajectory
from etude.limits.feasible import FeasibleSet
from etude.limits.samplers import amplitude, boundary, scaled, uniform

Sampler = Literal["scaled", "uniform"]

AMPLITUDE_SHARE = 4
"""Every fourth scaled candidate has a random amplitude: slow motion is sometimes what is missing."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """A point (P,) of the feasible set of a family whose omega0 has been drawn."""

    family: Family
    feasible: FeasibleSet
    p: Array

    @property
    def trajectory(self) -> Trajectory:
        return self.family.trajectory(self.p)


class Candidates:
    """Random trajectories of `family` inside `limits`, drawn one after the other from one stream.

    A family that leaves nothing to draw has one feasible set for all.
    """

    def __init__(self, family: Family, limits: tuple[Limit, ...], home: Array, sampler: Sampler) -> None:
        self.family, self.limits, self.home, self.sampler = family, limits, home, sampler
        self._whole: FeasibleSet | None = None

    def draw(self, rng: np.random.Generator, count: int, *, still: bool = True) -> list[Drawn]:
        """`count` of them; with `still` every fourth scaled one has a random amplitude.

        Raises:
            UnsafeTrajectoryError: the limits leave no room.
        """
        made = []
        for place in range(count):
            family = self.family.drawn(rng)
            feasible = self._feasible(family)
            made.append(Drawn(family, feasible, self._point(rng, family, feasible, place, still)))
        return made

    def _point(
        self, rng: np.random.Generator, family: Family, feasible: FeasibleSet, place: int, still: bool
    ) -> Array:
        if self.sampler == "uniform":
            return (uniform if place % 2 == 0 else boundary)(rng, feasible, 1)[0]
        slow = still and place % AMPLITUDE_SHARE == AMPLITUDE_SHARE - 1
        return (amplitude if slow else scaled)(rng, family, feasible)

    def _feasible(self, family: Family) -> FeasibleSet:
        if family is not self.family:
            return FeasibleSet.of(self.limits, family, self.home)
        if self._whole is None:
            self._whole = FeasibleSet.of(self.limits, family, self.home)
        return self._whole
