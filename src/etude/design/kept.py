"""Limits that are not convex: a penalty for the search, and their proof for what comes of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from etude.contracts import Array, Family, Limit
from etude.design.candidates import Drawn
from etude.design.objective import Objective
from etude.errors import UnsafeTrajectoryError
from etude.limits.certificate import certify

INSTANTS = 400
"""Evenly over a motion, at which penalties are asked for."""
ORDERS = 3
"""Derivative orders that penalties see: position, velocity, acceleration."""
HALVINGS = 12
"""Of the way home: the last proved point is within a thousandth of the way of one that is not."""
HEAVY = 10.0
"""Weight of the penalty of a typical candidate, in values of the criterion."""


@dataclass(frozen=True, eq=False)
class Kept:
    """The limits whose `cones` do not say it all; without any, nothing is done.

    Attributes:
        limits: those that answer with a penalty.
        times: (T,) s at which they are asked.
    """

    limits: tuple[Limit, ...]
    times: Array

    @classmethod
    def of(cls, limits: Sequence[Limit], family: Family, p: Array) -> Kept:
        """Those of `limits` that answer with a penalty for the member p (P,)."""
        duration = family.trajectory(p).duration
        times = duration * (np.arange(INSTANTS) + 0.5) / INSTANTS
        motion = family.motion(p, times, ORDERS)
        return cls(tuple(limit for limit in limits if limit.penalty(motion) is not None), times)

    def penalty(self, family: Family, p: Array) -> tuple[float, Array]:
        """Sum of the penalties at p (P,) and its gradient (P,); 0 where all are kept."""
        motion = family.motion(p, self.times, ORDERS)
        total, gradient = 0.0, np.zeros_like(motion.orders)
        for limit in self.limits:
            found = limit.penalty(motion)
            if found is not None:
                total, gradient = total + found[0], gradient + found[1]
        return total, family.pull(p, self.times, gradient)

    def weight(self, candidates: Sequence[Drawn]) -> float:
        """What a penalty counts for, in values of the criterion: typical candidates lose all of theirs."""
        found = [self.penalty(drawn.family, drawn.p)[0] for drawn in candidates] if self.limits else []
        typical = float(np.mean(found)) if found else 0.0
        return HEAVY / typical if typical > 0.0 else HEAVY

    def proved(self, family: Family, p: Array) -> bool:
        """Whether all of them hold, proved, on the trajectory of p (P,)."""
        return not certify(family.trajectory(p), self.limits).failed

    def drawn_home(self, family: Family, home: Array, p: Array) -> Array:
        """The parameters (P,), or the first on the way to `home` (P,) at which the limits are proved.

        Raises:
            UnsafeTrajectoryError: they are not even at home.
        """
        if not self.limits or self.proved(family, p):
            return p
        if not self.proved(family, home):
            names = ", ".join(limit.name for limit in self.limits)
            raise UnsafeTrajectoryError(
                f"standing still at home does not keep the limits {names}",
                where=names,
                next_step="Choose another home, or widen the limits.",
            )
        inside, outside = 0.0, 1.0
        for _ in range(HALVINGS):
            middle = 0.5 * (inside + outside)
            if self.proved(family, home + middle * (p - home)):
                inside = middle
            else:
                outside = middle
        return np.asarray(home + inside * (p - home))


@dataclass(frozen=True, eq=False)
class Penalised:
    """An objective less the weighted penalty, for the search alone."""

    objective: Objective
    kept: Kept
    weight: float

    @property
    def family(self) -> Family:
        return self.objective.family

    def value(self, p: Array) -> float:
        """The criterion less the penalty."""
        return self.objective.value(p) - self.weight * self.kept.penalty(self.family, p)[0]

    def value_and_gradient(self, p: Array) -> tuple[float, Array]:
        """Value and gradient (P,)."""
        value, gradient = self.objective.value_and_gradient(p)
        penalty, slope = self.kept.penalty(self.family, p)
        return value - self.weight * penalty, gradient - self.weight * slope
