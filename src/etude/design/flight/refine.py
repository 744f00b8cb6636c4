"""Local search from one flight: sequential quadratic programming under the exact convex limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from etude.design.flight.objective import FlightObjective
from etude.trajectories.flight.feasible_set import FeasibleSet

Array = NDArray[np.float64]

TOLERANCE = 1e-5
"""Change of the scaled objective at which the search ends."""
STEP = 1e-6
"""Of the finite differences, in half widths of the feasible set."""
VARIANCES = frozenset({"mean_variance", "ivr"})
"""Criteria that shrink with the model's variance: divided by their start, however small; others are nats."""


@dataclass(frozen=True)
class Refined:
    """Where a search ended.

    Attributes:
        parameters: (P,), inside the limits.
        value: of the criterion there.
        evaluations: of the criterion, with or without gradient.
    """

    parameters: Array
    value: float
    evaluations: int


def refine_flight(
    objective: FlightObjective,
    feasible: FeasibleSet,
    start: Array,
    *,
    criterion: str,
    steps: int,
    method: Literal["gradient", "finite_differences"] = "gradient",
) -> Refined:
    """The best flight that SLSQP finds in `steps` iterations from `start` (P,), drawn back inside.

    The objective is divided by its start: after a few flights variances are tiny, and a solver that sees
    1e-3 as converged would stop where it started. Variables are in half widths of the feasible set.
    """
    from scipy.optimize import minimize

    centre, widths = feasible.centre, feasible.widths()
    first = objective.value(start)
    scale = 1.0 / max(abs(first), 1e-12 if criterion in VARIANCES else 1.0)
    count = 1

    def cost(y: Array) -> float:
        nonlocal count
        count += 1
        return -scale * objective.value(centre + widths * y)

    def cost_and_slope(y: Array) -> tuple[float, Array]:
        nonlocal count
        count += 1
        value, gradient = objective.value_and_gradient(centre + widths * y)
        return -scale * value, -scale * widths * gradient

    limits = {
        "type": "ineq",
        "fun": lambda y: feasible.slack(centre + widths * y),
        "jac": lambda y: feasible.slack_jacobian(centre + widths * y) * widths,
    }
    exact = method == "gradient"
    options: dict[str, Any] = {"maxiter": max(steps, 1), "ftol": TOLERANCE} | ({} if exact else {"eps": STEP})
    found = minimize(
        cost_and_slope if exact else cost,
        (start - centre) / widths,
        jac=exact or None,
        method="SLSQP",
        constraints=[limits],
        options=options,
    )
    end = feasible.shrink(centre + widths * found.x) if np.all(np.isfinite(found.x)) else start
    return Refined(end, objective.value(end), count + 1)
