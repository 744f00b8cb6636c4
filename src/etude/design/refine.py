"""Local refinement of a candidate: L-BFGS over variables whose every value is inside the limits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from etude.lbfgs import minimise
from etude.limits.feasible import FeasibleSet
from etude.types import Array

CORNER = 30
"""p of the smooth corner at the edge of the limits; the final step takes back the few per cent it costs."""
LEAST_VALUE = 1e-12
"""Values are divided by that of the start, since L-BFGS takes differences far below 1 for converged."""


class Aim(Protocol):
    """What is maximised: an `Objective`, or one less a penalty."""

    def value(self, p: Array) -> float: ...
    def value_and_gradient(self, p: Array) -> tuple[float, Array]: ...


@dataclass(frozen=True, eq=False)
class Refined:
    """Where a refinement ended: parameters (P,) inside the limits, their value, evaluations."""

    p: Array
    value: float
    evaluations: int


def refine(objective: Aim, feasible: FeasibleSet, start: Array, steps: int) -> Refined:
    """The best point met in `steps` iterations from `start` (P,), on the exact edge where that is better."""
    search = Search(objective, feasible)
    first = search.variables(start)
    best = Best(-np.inf, first)

    def cost(y: Array) -> tuple[float, Array]:
        value, gradient = search.value_and_gradient(y)
        best.offer(value, y)
        scale = 1.0 / max(abs(best.first), LEAST_VALUE)
        return -scale * value, -scale * gradient

    minimise(cost, first, steps=steps, kept=20, searched=10)
    p, value = _to_the_edge(objective, feasible, search.inside(best.y), best.value)
    return Refined(p, value, best.count + len(feasible.blocks))


def _to_the_edge(objective: Aim, feasible: FeasibleSet, p: Array, value: float) -> tuple[Array, float]:
    """Each block in turn enlarged to the exact edge of its limits, where that raises the value."""
    full = feasible.enlarge(p)
    for block in feasible.blocks:
        trial = p.copy()
        trial[block.members] = full[block.members]
        trial_value = objective.value(trial)
        if trial_value > value:
            p, value = trial, trial_value
    return p, value


@dataclass
class Best:
    """The best point seen, because a line search may end elsewhere; first: the value where it began."""

    value: float
    y: Array
    count: int = 0
    first: float = 0.0

    def offer(self, value: float, y: Array) -> None:
        if not self.count:
            self.first = value
        self.count += 1
        if value > self.value:
            self.value, self.y = value, y.copy()


@dataclass(frozen=True, eq=False)
class Search:
    """The objective on variables that cannot leave the limits.

    p = centre + T y, T the ellipsoid of the limits' rows, so that numbers are of order one. A block that uses
    its limits by g is drawn towards the centre by (1 + g^p)^(-1/p), which is nearly 1 inside and 1/g outside,
    and always enough: g is the smooth gauge, never below the true one. So every evaluation is of a trajectory
    inside, and the search has no constraints and no corners.
    """

    objective: Aim
    feasible: FeasibleSet

    @cached_property
    def shape(self) -> Array:
        """T (P, P)."""
        return self.feasible.ellipsoid()

    def variables(self, p: Array) -> Array:
        """y (P,) of parameters, before any drawing."""
        return np.asarray(np.linalg.solve(self.shape, p - self.feasible.centre))

    def inside(self, y: Array) -> Array:
        """Parameters (P,) inside the limits."""
        offset = self.shape @ y
        use, _ = self.feasible.smooth_gauge(self.feasible.centre + offset)
        return np.asarray(self.feasible.centre + offset * _shrink(use)[self.feasible.block_of])

    def value_and_gradient(self, y: Array) -> tuple[float, Array]:
        """Value at the parameters of y, and its gradient in y."""
        block_of, offset = self.feasible.block_of, self.shape @ y
        use, use_gradient = self.feasible.smooth_gauge(self.feasible.centre + offset)
        shrink = _shrink(use)
        value, gradient = self.objective.value_and_gradient(self.feasible.centre + offset * shrink[block_of])
        along = np.bincount(block_of, offset * gradient, len(use))
        in_use = -along * shrink**2 * (use * shrink) ** (CORNER - 1)
        in_offset = gradient * shrink[block_of] + use_gradient * in_use[block_of]
        return value, np.asarray(self.shape.T @ in_offset)


def _shrink(use: Array) -> Array:
    """(1 + use^p)^(-1/p) without overflow."""
    larger = np.maximum(use, 1.0)
    rest = (1.0 / larger) ** CORNER + (use / larger) ** CORNER
    return np.asarray(rest ** (-1.0 / CORNER) / larger)
