"""Local refinement of a candidate: L-BFGS over variables whose every value is inside the limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.contracts import Array
from etude.design.objective import Objective
from etude.limits.feasible import FeasibleSet

CORNER = 30
"""p of the smooth corner at the edge of the limits; the final step takes back the few per cent it costs."""
LEAST_VALUE = 1e-12
"""Values are divided by that of the start, since L-BFGS takes differences far below 1 for converged."""


@dataclass(frozen=True, eq=False)
class Refined:
    """Where a refinement ended: parameters (P,) inside the limits, their value, evaluations."""

    p: Array
    value: float
    evaluations: int


def refine(objective: Objective, feasible: FeasibleSet, start: Array, steps: int) -> Refined:
    """The best point met in `steps` iterations from `start` (P,), on the exact edge where that is better."""
    from scipy.optimize import minimize

    search = Search(objective, feasible)
    first = search.variables(start)
    best = Best(-np.inf, first)
    scale = 0.0

    def cost(y: Array) -> tuple[float, Array]:
        nonlocal scale
        value, gradient = search.value_and_gradient(y)
        best.offer(value, y)
        scale = scale or 1.0 / max(abs(value), LEAST_VALUE)
        return -scale * value, -scale * gradient

    options = {"maxiter": steps, "maxcor": 20, "maxls": 10}
    minimize(cost, first, jac=True, method="L-BFGS-B", options=options)
    p, value, tried = _to_the_edge(objective, feasible, search.inside(best.y), best.value)
    return Refined(p, value, best.count + tried)


def _to_the_edge(
    objective: Objective, feasible: FeasibleSet, p: Array, value: float
) -> tuple[Array, float, int]:
    """Each block in turn enlarged to the exact edge of its limits, where that raises the value."""
    full = feasible.scale_to(p, enlarge=True)
    for block in feasible.blocks:
        trial = p.copy()
        trial[block] = full[block]
        trial_value = objective.value(trial)
        if trial_value > value:
            p, value = trial, trial_value
    return p, value, len(feasible.blocks)


@dataclass
class Best:
    """The best point seen, because a line search may end elsewhere."""

    value: float
    y: Array
    count: int = 0

    def offer(self, value: float, y: Array) -> None:
        self.count += 1
        if value > self.value:
            self.value, self.y = value, y.copy()


@dataclass(frozen=True, eq=False)
class Search:
    """The objective on variables that cannot leave the limits.

    p = centre + shape y, the shape that of the ellipsoid of the limits' rows, so that numbers are of order
    one. A block that uses its limits by g is drawn towards the centre by (1 + g^p)^(-1/p), which is nearly 1
    inside and 1/g outside, and always enough: g is the smooth gauge, never below the true one. So every
    evaluation is of a trajectory inside, and the search has no constraints and no corners.
    """

    objective: Objective
    feasible: FeasibleSet

    def variables(self, p: Array) -> Array:
        """y (P,) of parameters."""
        return self.feasible.shape_solve(p - self.feasible.centre)

    def inside(self, y: Array) -> Array:
        """Parameters (P,) inside the limits."""
        offset = self.feasible.shape @ y
        use, _ = self.feasible.smooth_gauge(self.feasible.centre + offset)
        return self.feasible.centre + offset * self._per_parameter(_shrink(use))

    def value_and_gradient(self, y: Array) -> tuple[float, Array]:
        """Value at the parameters of y, and its gradient in y."""
        offset = self.feasible.shape @ y
        use, use_gradient = self.feasible.smooth_gauge(self.feasible.centre + offset)
        drawn = _shrink(use)
        shrink = self._per_parameter(drawn)
        value, gradient = self.objective.value_and_gradient(self.feasible.centre + offset * shrink)
        pulled = np.array([offset[block] @ gradient[block] for block in self.feasible.blocks])
        in_use = -pulled * drawn**2 * (use * drawn) ** (CORNER - 1)
        in_offset = gradient * shrink + use_gradient * self._per_parameter(in_use)
        return value, self.feasible.shape.T @ in_offset

    def _per_parameter(self, values: Array) -> Array:
        """(P,) from one value per block."""
        out = np.ones(len(self.feasible.centre))
        for block, value in zip(self.feasible.blocks, values, strict=True):
            out[block] = value
        return out


def _shrink(use: Array) -> Array:
    """(1 + use^p)^(-1/p) without overflow."""
    larger = np.maximum(use, 1.0)
    rest = (1.0 / larger) ** CORNER + (use / larger) ** CORNER
    return np.asarray(rest ** (-1.0 / CORNER) / larger)
