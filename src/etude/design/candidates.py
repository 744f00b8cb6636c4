"""Random candidates: trajectories inside the limits, each with its own draw of what no search refines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from etude.design.nonconvex_limits import FEW_HALVINGS, NonconvexLimits
from etude.limits.feasible import FeasibleSet
from etude.limits.samplers import amplitude, boundary, scaled, uniform
from etude.protocols import Family, Limit, Trajectory
from etude.types import Array

Sampler = Literal["scaled", "uniform"]
Sample = Callable[[np.random.Generator, FeasibleSet, int], Array]

AMPLITUDE_SHARE = 4
"""One scaled candidate in so many has a random amplitude: slow motion is sometimes what is missing."""
STEPS = 60
"""Of the walk to each uniform candidate; they need to differ, not to be exactly uniform."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """A point p (P,) of the feasible set of a family whose omega0 has been drawn."""

    family: Family
    feasible: FeasibleSet
    p: Array

    @property
    def trajectory(self) -> Trajectory:
        return self.family.trajectory(self.p)

    @property
    def standing(self) -> Array:
        """(P,) standing still where all limits are kept."""
        return self.feasible.centre

    def allowed(self, kept: NonconvexLimits, p: Array, worth: Callable[[Array], float]) -> Drawn:
        """What a search has made of it (P,), drawn home until its limits hold, and grown where that is worth
        something.
        """
        p = kept.drawn_home(self.family, self.standing, p, quickly=True)
        return replace(self, p=kept.grown(self.family, self.standing, p, worth))


@dataclass(frozen=True, eq=False)
class Source:
    """Where random trajectories come from: a family, its limits, a pose inside them, a way to sample.

    What limits that are not convex forbid is drawn home.
    """

    family: Family
    limits: tuple[Limit, ...]
    home: Array
    sampler: Sampler

    def candidates(self, rng: np.random.Generator, count: int) -> list[Drawn]:
        """`count` of them to choose from: a quarter of random amplitude, or half on the edge.

        Raises:
            UnsafeTrajectoryError: the limits leave no room.
        """
        if self.sampler == "uniform":
            half = count // 2
            first = self._drawn(rng, count - half, lambda r, s, n: uniform(r, s, n, STEPS))
            return [*first, *self._drawn(rng, half, boundary)]
        slow = count // AMPLITUDE_SHARE
        return [*self._drawn(rng, count - slow, scaled), *self._drawn(rng, slow, amplitude)]

    def typical(self, rng: np.random.Generator, count: int, *, grown: bool = False) -> list[Drawn]:
        """`count` large ones, as motions that stand in for tasks; or grown, as first trajectories."""
        found = self._drawn(rng, count, uniform if self.sampler == "uniform" else scaled)
        return [self._grown(drawn) for drawn in found] if grown else found

    def _grown(self, drawn: Drawn) -> Drawn:
        kept = NonconvexLimits.of(self.limits, drawn.family, drawn.p)
        home = drawn.feasible.centre
        p = kept.grown(drawn.family, home, drawn.p)
        return replace(drawn, p=kept.settled(drawn.family, home, p))

    @cached_property
    def _whole(self) -> FeasibleSet:
        return self._set(self.family)

    def _set(self, family: Family) -> FeasibleSet:
        return FeasibleSet.of(self.limits, family, self.home)

    def _drawn(self, rng: np.random.Generator, count: int, sample: Sample) -> list[Drawn]:
        """A family that leaves nothing to draw has one feasible set, and all are sampled at once."""
        families = [self.family.drawn(rng) for _ in range(count)]
        found: dict[int, Drawn] = {}
        for family in {id(one): one for one in families}.values():
            places = [i for i, one in enumerate(families) if one is family]
            feasible = self._whole if family is self.family else self._set(family)
            points, home = sample(rng, feasible, len(places)), feasible.centre
            kept = NonconvexLimits.of(self.limits, family, home)
            for place, p in zip(places, points, strict=True):
                p = kept.drawn_home(family, home, p, FEW_HALVINGS, quickly=True)
                found[place] = Drawn(family, feasible, p)
        return [found[place] for place in range(count)]
